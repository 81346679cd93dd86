"""Identities on a network: certificates, their roles, and the gate's access control."""
