"""Everything that the processes share. No other package imports zenoh.

Read the modules at the root to write a service:

- `node`: Node: publish, listen, serve, ticks and wait_for.
- `entry`: start(name, run): arguments, session, parameters, exit status.
- `errors`: the exception tree, with an exit code for each class.
- `executor`: the event loop: one thread runs the handlers of a node, or of several in turn.
- `server`: the server side of a service: exactly-once, scheduled calls, call log.
- `followed_params`: parameters of another node, kept at the values that it has accepted.
- `shutdown`: signals and the death of the parent process.
- `realm`: one isolated run: its name, its folder and its socket.
- `process_table`: which processes a run has, and when a dead one is started again.
- `run_files`: the files that a run keeps in its folder for commands to read.
- `testing`: play(): run a service on recorded messages, without a bus.
- `terminal`: texts and JSON to print, without characters that control a terminal or hide.
- `files`, `filelock`, `procfs`: new files, a lock that dies with its holder, figures from /proc.

The folders are the machinery behind them:

- `bus/`: Zenoh: sessions, router, codec, publishers, subscribers, calls, liveliness.
- `params/`: from TOML files and overrides to checked values, and to a running node.
- `recording/`: MCAP files: write, read and verify.
- `security/`: certificates, roles and access control.
- `supervisor/`: start, watch, restart and end the processes of a run.
"""
