"""A body far from all that were flown: refused, or flown with a warning at every turn."""

from tests.support.lab import Lab

HEAVY = "[dynamics]\nunproven = true\nvehicle.mass = 2.1"


def test_a_body_far_from_all_that_were_flown_flies_with_a_warning_if_the_file_says_so(lab: Lab):
    file = lab.file(HEAVY, "heavy.toml")
    up = lab.quadctl("up", "-d", file)
    assert up.code == 0
    assert "mass 2.1 is not within 0.5 to 2: no promise holds so far from the lab's" in up.err
    assert lab.quadctl("goto", 1, 1, 1, "--replace").code == 0
    assert "warning: no promise holds for uav: dynamics.unproven" in lab.quadctl("status").out
    assert lab.quadctl("status", "--json").json["unproven"] == ["uav"]
    found = {each["name"]: each for each in lab.quadctl("doctor", "--json").json["checks"]}
    assert found["promises"]["verdict"] == "WARN"
    # The file alone may say so, at launch.
    done = lab.quadctl("param", "set", "dynamics.unproven", "false")
    assert (done.code, "fixed at launch" in done.err) == (6, True)
    assert lab.quadctl("param", "set", "dynamics.vehicle.mass", 2.2).code == 0
