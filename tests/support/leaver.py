"""Client with a certificate that declares much, and waits to be killed."""

import sys
import time
from pathlib import Path
from typing import Any

from tests.support.intruder import session


def main(endpoint: str, identity: Path, kind: str, count: int) -> None:
    with session(endpoint, identity) as client:
        declare: dict[str, Any] = {
            "subscribers": lambda n: client.declare_subscriber(f"uav0/own/x{n}", print),
            "queryables": lambda n: client.declare_queryable(f"uav0/own/x{n}", print),
            "tokens": lambda n: client.liveliness().declare_token(f"uav0/@node/own-{n}"),
            "wildcards": lambda n: client.declare_subscriber(f"uav0/**/x{n}/**", print),
            "stars": lambda n: client.declare_subscriber(f"uav0/own/$*a$*b{n}$*", print),
            "chunks": lambda n: client.declare_subscriber("uav0/own" + 10_000 * "/a", print),
        }
        print("declaring", flush=True)
        held = [declare[kind](number) for number in range(count)]
        print("declared", flush=True)
        time.sleep(len(held) and 60)


if __name__ == "__main__":
    main(sys.argv[1], Path(sys.argv[2]), sys.argv[3], int(sys.argv[4]))
