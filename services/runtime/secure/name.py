"""Who holds a certificate. Pure."""

from msgspec import Struct

from schemas.roles import Role


class Name(Struct, frozen=True):
    """One holder of a certificate, which is good until `expires` (Unix time, s)."""

    name: str
    role: Role
    vehicles: list[str]
    serial: str
    expires: float

    @property
    def common_name(self) -> str:
        """The certificate's own name, as `student.anna.1a2b3c4d`."""
        return f"{self.role}.{self.name}.{self.serial}"

    @property
    def of(self) -> str:
        """Its vehicles for a message."""
        return "all vehicles" if self.vehicles == ["*"] else ", ".join(self.vehicles)
