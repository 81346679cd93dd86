"""The console's page in a browser: the actions of a user and their effects."""

import json
import signal
from collections.abc import Iterator
from urllib.parse import urlsplit

import pytest

from tests.support.browser import PHONE, Browser, Tab, browser
from tests.support.lab import NODES, Lab, private_lab, sets
from tests.support.running import eventually
from tests.support.served_console import Console, served

# A pose may be late on a machine that is busy drawing a page.
SETTINGS = sets("dynamics.start.z=1", "safety.virtual_cage.z=2", "safety.pose_timeout=5")


@pytest.fixture(scope="module")
def running_lab() -> Iterator[Lab]:
    """Running system with one vehicle, in the air at (0, 0, 1)."""
    with private_lab() as made:
        made.start(*SETTINGS)
        yield made


@pytest.fixture(scope="module")
def console(running_lab: Lab) -> Iterator[Console]:
    """Console of that system."""
    with served(running_lab) as made:
        yield made


@pytest.fixture(scope="module")
def chromium() -> Iterator[Browser]:
    """Browser with an empty profile."""
    with browser() as made:
        yield made


pytestmark = [pytest.mark.thorough, pytest.mark.needs("browser")]

LIVE = "document.body?.dataset.link === 'live'"


@pytest.fixture(scope="module")
def page(console: Console, chromium: Browser) -> Iterator[Tab]:
    """Controlling page in one tab that the tests share."""
    tab = chromium.tab(console.control)
    tab.until(LIVE)
    tab.until("document.body.dataset.state === 'HOVERING'")
    yield tab
    assert tab.errors == []
    tab.close()


@pytest.fixture
def phone(console: Console, chromium: Browser) -> Iterator[Tab]:
    """Controlling page with the screen of a phone."""
    tab = chromium.tab(console.control, PHONE)
    tab.until(LIVE)
    yield tab
    assert tab.errors == []
    tab.close()


@pytest.fixture(autouse=True)
def at_rest(page: Tab) -> None:
    """Wait for a hover, so that no test begins during the flight of another."""
    page.front()
    page.js("document.activeElement?.blur()")  # keys would go to a field that a test has typed in
    page.until("document.body.dataset.state === 'HOVERING'")


def position(lab: Lab) -> tuple[float, ...]:
    at = lab.quadctl("state", "--json").json["pose"]["position"]
    return tuple(round(at[axis], 1) for axis in "xyz")


def test_a_click_on_the_floor_flies_there(page: Tab, running_lab: Lab):
    page.floor(2, 1)
    page.reads(".journal", "accepted", "arrived", "at (2, 1, 1)")
    eventually(lambda: position(running_lab) == (2.0, 1.0, 1.0))
    page.reads(".readout", "2.00")


def test_a_goal_outside_is_refused_with_its_reason(page: Tab):
    page.floor(6, 0)
    said = "outside the cage: x = 6 is beyond [-5, 5]"
    page.reads(".journal", "refused", said)
    page.reads(".reason", said)
    page.reads("#q-notify", said)


def test_arrow_keys_move_the_target_by_a_metre_and_enter_sends_it(page: Tab, running_lab: Lab):
    assert running_lab.quadctl("goto", 0, 0, 1).code == 0
    page.reads(".safety dd", "(0, 0, 1)")
    for key in ("ArrowLeft", "ArrowLeft", "ArrowUp"):
        page.key(key)
    page.reads(".target", "(-2, 1, 1)")
    page.key("Enter")
    page.reads(".journal", "at (-2, 1, 1)")
    eventually(lambda: position(running_lab) == (-2.0, 1.0, 1.0))
    assert page.text(".target") == ""


def test_the_cage_switch_turns_the_cage_off_and_on(page: Tab, running_lab: Lab):
    # The page shows the cage as off until the first state arrives.
    page.until("document.body.dataset.cage === 'on'")
    for word, on in (("off", False), ("on", True)):
        page.press(".buttons .q-toggle")
        page.until(f"document.body.dataset.cage === '{word}'")
        assert running_lab.quadctl("cage", "show", "--json").json["on"] is on
    page.reads(".journal", "cage off", "cage on")


def test_the_cage_switch_follows_a_cage_turned_off_elsewhere(page: Tab, running_lab: Lab):
    switch = "document.querySelector('.buttons .q-toggle').getAttribute('aria-checked')"
    assert running_lab.quadctl("cage", "off").code == 0
    page.until(f"{switch} === 'false'")
    assert running_lab.quadctl("cage", "on").code == 0
    page.until(f"{switch} === 'true'")


def test_calibrating_shows_the_baseline(page: Tab):
    page.press(".act.calibrate")
    assert "1013." in page.reads(".readings dd", "hPa")
    page.reads(".journal", "baseline 1013.")


@pytest.mark.parametrize("fault", ["barometer-stuck", "motor-weak"])
def test_a_click_injects_and_clears_a_fault(page: Tab, running_lab: Lab, fault: str):
    button = f".faults [data-fault={fault}]"

    def is_active() -> bool:
        faults = running_lab.quadctl("fault", "list", "--json").json
        return bool(next(row["active"] for row in faults if row["name"] == fault))

    # Page and command read the node's values at different moments.
    for there, condition in (("true", is_active), ("false", lambda: not is_active())):
        page.press(button)
        page.until(f"document.querySelector('{button}').getAttribute('aria-pressed') === '{there}'")
        eventually(condition)


def test_a_fault_injected_elsewhere_is_highlighted(page: Tab, running_lab: Lab):
    assert running_lab.quadctl("fault", "inject", "gust").code == 0
    page.until("document.querySelector('[data-fault=gust]').classList.contains('in')")
    assert running_lab.quadctl("fault", "clear").code == 0
    page.until("!document.querySelector('[data-fault=gust]').classList.contains('in')")


def enter_parameter(page: Tab, name: str, text: str) -> None:
    field = f"[data-param='{name}'] input"
    page.press(field)
    page.js(f"document.querySelector({json.dumps(field)}).select()")
    page.type(text)
    page.key("Enter")


def parameter_value(page: Tab, name: str) -> str:
    return f"""document.querySelector("[data-param='{name}'] input").value"""


def test_a_parameter_is_changed_and_checked(page: Tab, running_lab: Lab):
    name = "safety.virtual_cage.x"
    page.until(f"{parameter_value(page, name)} === '5.0'")
    enter_parameter(page, name, "4")
    page.reads(".safety", "x [-4, 4]")
    assert running_lab.quadctl("param", "get", name, "--json").json == {name: 4.0}
    enter_parameter(page, name, "0.1")
    page.reads(".q-notification.bg-negative", "0.2")
    page.until(f"{parameter_value(page, name)} === '4.0'")
    assert running_lab.quadctl("param", "set", name, 5).code == 0
    page.until(f"{parameter_value(page, name)} === '5.0'")


def test_every_table_of_parameters_can_be_opened(page: Tab):
    tabs = "[...document.querySelectorAll('.parameters .q-tab')]"
    for table, row in (
        ("pressure", "pressure.noise"),
        ("dynamics.control", "dynamics.control.max_jerk"),
        ("safety", "safety.takeoff"),
    ):
        page.js(f"{tabs}.find(tab => tab.textContent.trim() === '{table}').click()")
        page.until(f"!!document.querySelector(\"[data-param='{row}']\")")
    page.reads("[data-param='safety.takeoff']", "[0, 10000] m", "height of the first goal")


ZONES = """
[[safety.zones]]
name = "tower"
polygon = [[1.0, -1.0], [2.0, -1.0], [2.0, 1.0], [1.0, 1.0]]
[[safety.zones]]
name = "pond"
circle = { x = -3.0, y = 0.0, radius = 1.0 }
"""


def test_zones_are_drawn_with_the_nearest_wall_and_the_leg_around_them(page: Tab, running_lab: Lab):
    labels, nearest = ".scene .labels", ".safety [data-read=nearest]"
    assert running_lab.quadctl("goto", 0, 0, 1, "--settle").code == 0
    assert running_lab.quadctl("zone", "add", running_lab.file(ZONES, "zones.toml")).code == 0
    page.reads(labels, "tower", "pond")
    page.reads(nearest, "cage, 1.00 m")
    assert running_lab.quadctl("goto", 0.7, 0, 1, "--settle").code == 0
    page.reads(nearest, "tower, 0.30 m")
    page.until("document.body.dataset.near === 'true'")
    page.floor(3, 0)
    page.reads(".safety .leg", "leg 1 of 3")
    page.reads(".safety .leg", "leg 3 of 3")
    page.reads(".journal", "at (3, 0, 1)")
    page.until("!document.querySelector('.safety .leg').innerText")
    assert running_lab.quadctl("zone", "remove", "pond").code == 0
    page.until("!document.querySelector('.scene .labels').innerText.includes('pond')")
    page.reads(labels, "tower")
    assert running_lab.quadctl("zone", "remove", "tower").code == 0


def test_a_killed_process_is_shown_and_can_be_restarted(page: Tab, running_lab: Lab):
    row = ".processes [data-node=pressure]"
    old = running_lab.signal("pressure", signal.SIGKILL)
    page.reads(row, "1 restart")
    running_lab.revived("pressure", old)
    now = running_lab.nodes()["pressure"]["pid"]
    page.reads(row, "ready", str(now))
    right = "document.querySelector('%s').getBoundingClientRect().right"
    assert page.js(f"{right % f'{row} button'} <= {right % '.processes'}")
    page.press(f"{row} button")
    running_lab.revived("pressure", now)
    page.reads(row, "ready", str(running_lab.nodes()["pressure"]["pid"]))
    page.reads(".journal", "process", f"in place of {now}")
    assert all(page.text(f".processes [data-node={node}]") for node in NODES)


def test_reset_returns_the_vehicle_to_its_start(page: Tab, running_lab: Lab):
    page.floor(1, 1)
    page.reads(".journal", "at (1, 1, 1)")
    page.press(".act.reset")
    eventually(lambda: position(running_lab)[:2] == (0.0, 0.0))
    page.reads(".journal", "boot")


def test_the_page_requests_nothing_from_another_machine(page: Tab, console: Console):
    here = urlsplit(console.control).netloc
    asked = {urlsplit(url) for url in page.requests}
    assert {url.netloc for url in asked if url.scheme in {"http", "https", "ws", "wss"}} == {here}
    assert {url.scheme for url in asked} <= {"http", "ws", "data", "blob", "about"}


def test_a_page_without_the_token_cannot_change_anything(
    console: Console, chromium: Browser, running_lab: Lab
):
    watching = chromium.tab(console.watch)
    watching.until(LIVE)
    watching.reads(".top", "watching only")
    before = running_lab.quadctl("state", "--json").json
    pids = [node["pid"] for node in running_lab.nodes().values()]
    # Send every event that the server listens for, with the arguments of a controlling page.
    sent = watching.js("""(() => {
        let sent = 0;
        for (const [id, element] of Object.entries(mounted_app.elements))
            for (const event of element.events ?? [])
                for (const args of [{x: 1, y: 1}, "ArrowUp", true, false, {value: 1}, null]) {
                    const about = {id: Number(id), client_id: window.clientId, listener_id: event.listener_id};
                    window.socket.emit("event", {...about, args: [JSON.stringify(args)]});
                    sent += 1;
                }
        return sent;
    })()""")
    assert sent > 20
    came = "window.came = (window.came ?? 0)"
    watching.js(f"{came}, window.addEventListener('quadctl', () => (window.came += 1)), 0")
    watching.until("window.came > 5")
    after = running_lab.quadctl("state", "--json").json
    told = ("request", "boot", "cage_on", "cage", "goal", "reason")
    assert {name: after[name] for name in told} == {name: before[name] for name in told}
    assert [node["pid"] for node in running_lab.nodes().values()] == pids
    watching.close()


def test_a_phone_shows_the_page_without_sideways_scrolling(phone: Tab, page: Tab):
    assert phone.js("document.documentElement.scrollWidth") == PHONE[0]
    phone.press(".act.hold")
    phone.reads(".reason", "hold: stopped on request")
    page.reads(".reason", "hold: stopped on request")


def test_a_browser_that_stops_reading_is_sent_nothing_more(phone: Tab, page: Tab):
    phone.js("""(() => {
        window.sent = 0;
        const live = getElement(Number(document.querySelector(".live").id.slice(1)));
        live.show = () => { window.sent += 1; return new Promise(() => {}); };
    })()""")
    phone.until("window.sent === 1")
    page.floor(-1, -1)
    page.reads(".journal", "at (-1, -1, 1)")
    assert phone.js("window.sent") == 1


def test_the_page_reports_a_lost_run_and_reconnects_by_itself(page: Tab, running_lab: Lab):
    assert running_lab.quadctl("down").code == 0
    page.until("document.body.dataset.link === 'lost'")
    page.reads(".banner", "nothing is running")
    page.press(".act.hold")
    page.reads(".q-notification:last-child", "not connected")
    running_lab.start(*SETTINGS)
    page.until(LIVE)
    page.floor(1, 0)
    page.reads(".journal", "at (1, 0, 1)")


def test_what_is_not_known_is_shown_as_not_known(chromium: Browser):
    with private_lab() as lab:
        lab.start("--without", "safety", "--set", "dynamics.start.z=1")
        with served(lab) as console:
            tab = chromium.tab(console.control)
            tab.until(LIVE)
            tab.until("document.querySelector('[data-fault=motor-weak]').ariaDisabled !== 'true'")
            switch = "document.querySelector('.safety .q-toggle')"
            assert tab.js(f"[{switch}.ariaChecked, {switch}.ariaDisabled]") == ["mixed", "true"]
            assert tab.js("document.querySelector('.act.hold').ariaDisabled") == "true"
            assert tab.errors == []
            tab.close()


# The heights of the dots in the picture, which Vue keeps.
HEIGHTS = """(() => {
  const { others } = getElement(Number(document.querySelector('.scene').id.slice(1)));
  const places = others.children[0].geometry.attributes.position;
  return places ? [...Array(places.count).keys()].map((n) => places.getZ(n)).sort() : [];
})()"""


def test_the_other_vehicles_of_the_run_are_shown_where_they_hold_or_fly_to(chromium: Browser):
    with private_lab() as fleet:
        fleet.start("--vehicles", 3, *SETTINGS)
        with served(fleet) as console:
            page = chromium.tab(console.control)
            page.until(LIVE)
            page.until(f"{HEIGHTS}.join() === '1,1'")
            assert fleet.quadctl("goto", 0, 0, 1.5, "--vehicle", "uav1", "--settle").code == 0
            page.until(f"{HEIGHTS}.join() === '1,1.5'")
            page.close()
