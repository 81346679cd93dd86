"""Identities on a network: certificates, who has which role, and what the gate lets through."""
