"""Machines without something, as mount and network namespaces: tests of them need "mounts"."""

from pathlib import Path

from tests.support import abilities
from tests.support.namespaces import tool


def poor(script: str) -> list[str]:
    """Return the words that put a command on a machine of its own, after a shell script there."""
    enter = [tool("unshare"), *abilities.as_root(), "--mount", "--net"]
    return [*enter, "sh", "-c", f'set -e; {script}; exec "$@"', "sh"]


def small_disk(folder: Path, size: str) -> str:
    """Return the script that puts a disk of a size, e.g. 1m, into a folder."""
    return f"mount -t tmpfs -o size={size},mode=700 none {folder}"


_CHROOT = """
mount --make-rshared /
mkdir {0}
for each in /*; do
    if [ -L "$each" ]; then cp -P "$each" {0}
    elif [ -d "$each" ]; then mkdir "{0}$each"; mount --rbind "$each" "{0}$each"
    fi
done
set -- chroot {0} sh -c 'cd "$0"; exec "$@"' "$PWD" "$@"
"""


def chroot(folder: Path) -> str:
    """Return the script that enters a root which is no mount point, and whose mounts are shared.

    The folder, a new one, gets all that the machine has.
    """
    return _CHROOT.format(folder).strip()


WITHOUT_SHARED_MEMORY = "mount -t tmpfs -o ro,size=4k none /dev/shm"
WITHOUT_IPV6 = (
    "ip link set lo up; for each in all lo; do"
    " echo 1 > /proc/sys/net/ipv6/conf/$each/disable_ipv6; done"
)
