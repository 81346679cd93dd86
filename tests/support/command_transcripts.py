"""Exact exit code, stdout and stderr of commands, by the typed line."""

CALIBRATE = "bool zero\n---\nfloat64 baseline\n"
GOTO = "float64 x\nfloat64 y\nfloat64 z\nbool replace\nbool direct\nbool wait\n---\nbool accepted\nstring reason\n"
OUTSIDE = "error: outside the cage: x = 9 is beyond [-5, 5]\n"
SAY_MORE = "  try: `quadctl cage show` and `quadctl state` show more\n"
FIELDS = "  try: `quadctl type show calibrate_pressure` prints the fields\n"
DROPPED, HELD = "uav/@srv/dropping/call", "uav/@srv/holding/call"
FOREIGN = "uav/@srv/foreign/get_params"

TRANSCRIPTS = {
    "type show calibrate_pressure": (0, CALIBRATE, ""),
    "type show calibrate": (0, CALIBRATE, ""),
    "type show /toggle_cage": (0, "bool cage_on\n---\nbool success\n", ""),
    "type show goto": (0, GOTO, ""),
    "type show input/position_request": (0, "float64 x\nfloat64 y\nfloat64 z\n", ""),
    "service info /calibrate_pressure": (
        0,
        (
            "Node:   pressure\n"
            "Key:    uav/@srv/calibrate_pressure\n"
            "Type:   Calibrate\n"
            f"About:  Zero the barometer here.\n{CALIBRATE}"
        ),
        "",
    ),
    "service info goto": (
        0,
        f"Node:   safety\nKey:    uav/@srv/goto\nType:   Goto\nAbout:  Fly to a verified point.\n{GOTO}",
        "",
    ),
    "param get safety.virtual_cage.x": (0, "5.0\n", ""),
    "param get /safety/virtual_cage": (
        0,
        "safety.virtual_cage.x: 5.0\nsafety.virtual_cage.y: 5.0\nsafety.virtual_cage.z: 2.0\n",
        "",
    ),
    "cage show": (
        0,
        "cage is on\ncage x - [-5.0, 5.0]\ncage y - [-5.0, 5.0]\ncage z - [0.0, 2.0]\n",
        "",
    ),
    "calibrate --unset": (0, "baseline: 0.0000 hPa\n", ""),
    "service call /calibrate_pressure False": (0, "baseline: 0.0\n", ""),
    "service call toggle_cage cage_on=true": (0, "success: True\n", ""),
    "goto 9 0 1": (5, "rejected\n", OUTSIDE + SAY_MORE),
    "service call goto 9 0 1": (
        5,
        "accepted: False\nreason: 'outside the cage: x = 9 is beyond [-5, 5]'\n",
        OUTSIDE + SAY_MORE,
    ),
    "goto 1 2 nan": (
        6,
        "",
        (
            "error: z = nan is not a valid coordinate\n"
            "  try: coordinates are metres, finite, and at most 10 km from the origin\n"
        ),
    ),
    "goto 1 2": (2, "", "error: Missing argument 'Z'.\n  try: `quadctl goto --help`\n"),
    "goto 1 b 2": (
        2,
        "",
        "error: Invalid value for 'Y': 'b' is not a valid float.\n  try: `quadctl goto --help`\n",
    ),
    "service call calibrate_pressure": (
        6,
        "",
        "error: not a valid CalibrateRequest: Object missing required field `zero`\n" + FIELDS,
    ),
    "service call calibrate_pressure zero=3": (
        6,
        "",
        "error: not a valid CalibrateRequest: Expected `bool`, got `int` - at `$.zero`\n" + FIELDS,
    ),
    "service call calibrat True": (
        6,
        "",
        "error: there is no service calibrat\n  try: did you mean calibrate_pressure?\n",
    ),
    "type show Waypont": (
        6,
        "",
        "error: there is no type Waypont\n  try: did you mean waypoint?\n",
    ),
    "service info pressure/get_parms": (
        6,
        "",
        "error: there is no service pressure/get_parms\n  try: did you mean pressure/get_params?\n",
    ),
    f"service call {DROPPED} a=1": (
        3,
        "",
        (
            f"error: the server of {DROPPED} ended the call without an answer: the outcome is unknown\n"
            "  try: its handler may have failed: see the log of its process\n"
        ),
    ),
    "service call uav/@srv/nobody --timeout 1": (
        3,
        "",
        (
            "error: nobody served uav/@srv/nobody within 1 s\n"
            "  try: its process is down or does not offer it, or this identity may not call it:"
            " `quadctl status`, `quadctl service list`\n"
        ),
    ),
    f"service call {HELD} --timeout 0.5": (
        4,
        "",
        (
            f"error: {HELD} did not answer within 0.5 s\n"
            "  try: its process is busy or frozen: `quadctl status` shows which\n"
        ),
    ),
}
