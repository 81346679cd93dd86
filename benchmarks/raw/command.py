"""Command on bare Zenoh, for its cost: import, open, one operation, close.

`command.py ENDPOINT get|list|echo|put KEY`: as short as possible, without any check.
"""

import os
import sys
import threading

import zenoh

endpoint, verb, key = sys.argv[1:]
config = zenoh.Config.from_json5(
    f'{{mode: "client", connect: {{endpoints: ["{endpoint}"]}},'
    " scouting: {multicast: {enabled: false}}, transport: {shared_memory: {enabled: false}}}"
)
session = zenoh.open(config)
found = 0
if verb == "get":
    # {"cage_on": true} in MessagePack.
    for reply in session.get(key, payload=b"\x81\xa7cage_on\xc3"):
        found += len(reply.ok.payload.to_bytes())
elif verb == "list":
    for reply in session.liveliness().get(key):
        found += len(str(reply.ok.key_expr))
elif verb == "echo":
    came = threading.Event()
    subscriber = session.declare_subscriber(key, lambda _: came.set())
    found = came.wait(3.0)
else:
    session.put(key, bytes(16))
    found = True
session.close()
print(found)
sys.stdout.flush()
os._exit(0 if found else 1)
