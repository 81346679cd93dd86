"""Machines without something, as mount and network namespaces: tests of them need "mounts"."""

from pathlib import Path

from tests.support.namespaces import tool


def poor(script: str) -> list[str]:
    """Return the words that put a command on a machine of its own, after a shell script there."""
    enter = [tool("unshare"), "--map-root-user", "--mount", "--net"]
    return [*enter, "sh", "-c", f'set -e; {script}; exec "$@"', "sh"]


def small_disk(folder: Path, size: str) -> str:
    """Return the script that puts a disk of a size, e.g. 1m, into a folder."""
    return f"mount -t tmpfs -o size={size},mode=700 none {folder}"


WITHOUT_SHARED_MEMORY = "mount -t tmpfs -o ro,size=4k none /dev/shm"
WITHOUT_IPV6 = (
    "ip link set lo up; for each in all lo; do"
    " echo 1 > /proc/sys/net/ipv6/conf/$each/disable_ipv6; done"
)
