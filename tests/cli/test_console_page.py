"""The console's page in a browser: what a user does there, and what comes of it."""

import json
import signal
from collections.abc import Iterator
from urllib.parse import urlsplit

import pytest

from tests.support.browser import PHONE, Browser, Tab, browser
from tests.support.lab import NODES, Lab, private_lab
from tests.support.running import eventually
from tests.support.served_console import Console, served

# On a machine that is busy drawing a page, a pose may be late.
SETTINGS = [
    word
    for name in ("dynamics.start.z=1", "safety.virtual_cage.z=2", "safety.pose_timeout=5")
    for word in ("--set", name)
]


@pytest.fixture(scope="module")
def flown() -> Iterator[Lab]:
    """A running system with one vehicle, in the air at (0, 0, 1)."""
    with private_lab() as made:
        made.start(*SETTINGS)
        yield made


@pytest.fixture(scope="module")
def console(flown: Lab) -> Iterator[Console]:
    """Its console."""
    with served(flown) as made:
        yield made


@pytest.fixture(scope="module")
def chromium() -> Iterator[Browser]:
    """A browser with an empty profile."""
    with browser() as made:
        yield made


pytestmark = pytest.mark.browser

LIVE = "document.body?.dataset.link === 'live'"


@pytest.fixture(scope="module")
def page(console: Console, chromium: Browser) -> Iterator[Tab]:
    """The page of who may control, in one tab that the tests share."""
    tab = chromium.tab(console.control)
    tab.until(LIVE, 40)
    tab.until("document.body.dataset.state === 'HOVERING'")
    yield tab
    assert tab.errors == []
    tab.close()


@pytest.fixture(scope="module")
def phone(console: Console, chromium: Browser) -> Iterator[Tab]:
    """The same on a phone."""
    tab = chromium.tab(console.control, PHONE)
    tab.until(LIVE, 40)
    yield tab
    assert tab.errors == []
    tab.close()


@pytest.fixture(autouse=True)
def at_rest(page: Tab) -> None:
    """No test begins in another's flight."""
    page.until("document.body.dataset.state === 'HOVERING'")


def position(lab: Lab) -> tuple[float, ...]:
    at = lab.quadctl("state", "--json").json["pose"]["position"]
    return tuple(round(at[axis], 1) for axis in "xyz")


def test_a_click_on_the_floor_flies_there(page: Tab, flown: Lab):
    page.floor(2, 1)
    page.reads(".journal", "accepted", "arrived", "at (2, 1, 1)")
    eventually(lambda: position(flown) == (2.0, 1.0, 1.0))
    page.reads(".readout", "2.00")


def test_a_goal_outside_is_refused_with_its_reason(page: Tab):
    page.floor(6, 0)
    said = "outside the cage: x = 6 is beyond [-5, 5]"
    page.reads(".journal", "refused", said)
    page.reads(".reason", said)
    page.reads(".q-notification", said)


def test_keys_aim_by_a_metre_and_enter_sends(page: Tab, flown: Lab):
    assert flown.quadctl("goto", 0, 0, 1).code == 0
    page.reads(".safety dd", "(0, 0, 1)")
    for key in ("ArrowLeft", "ArrowLeft", "ArrowUp"):
        page.key(key)
    page.reads(".target", "(-2, 1, 1)")
    page.key("Enter")
    page.reads(".journal", "at (-2, 1, 1)")
    eventually(lambda: position(flown) == (-2.0, 1.0, 1.0))
    assert page.text(".target") == ""


def test_the_cage_goes_off_and_on(page: Tab, flown: Lab):
    # Until a state has come the page shows a cage that is off.
    page.until("document.body.dataset.cage === 'on'")
    for word, on in (("off", False), ("on", True)):
        page.press(".buttons .q-toggle")
        page.until(f"document.body.dataset.cage === '{word}'")
        assert flown.quadctl("cage", "show", "--json").json["on"] is on
    page.reads(".journal", "cage off", "cage on")


def test_the_switch_follows_a_cage_that_somebody_else_turns_off(page: Tab, flown: Lab):
    switch = "document.querySelector('.buttons .q-toggle').getAttribute('aria-checked')"
    assert flown.quadctl("cage", "off").code == 0
    page.until(f"{switch} === 'false'")
    assert flown.quadctl("cage", "on").code == 0
    page.until(f"{switch} === 'true'")


def test_calibrating_shows_the_baseline(page: Tab):
    page.press(".act.calibrate")
    assert "1013." in page.reads(".readings dd", "hPa")
    page.reads(".journal", "baseline 1013.")


@pytest.mark.parametrize("fault", ["barometer-stuck", "motor-weak"])
def test_a_fault_goes_in_and_out_by_a_click(page: Tab, flown: Lab, fault: str):
    button = f".faults [data-fault={fault}]"
    for there in ("true", "false"):
        page.press(button)
        page.until(f"document.querySelector('{button}').getAttribute('aria-pressed') === '{there}'")
        faults = flown.quadctl("fault", "list", "--json").json
        assert [row["active"] for row in faults if row["name"] == fault] == [there == "true"]


def test_a_fault_that_somebody_else_puts_in_is_lit(page: Tab, flown: Lab):
    assert flown.quadctl("fault", "inject", "gust").code == 0
    page.until("document.querySelector('[data-fault=gust]').classList.contains('in')")
    assert flown.quadctl("fault", "clear").code == 0
    page.until("!document.querySelector('[data-fault=gust]').classList.contains('in')")


def enter(page: Tab, name: str, text: str) -> None:
    field = f"[data-param='{name}'] input"
    page.press(field)
    page.js(f"document.querySelector({json.dumps(field)}).select()")
    page.type(text)
    page.key("Enter")


def value(page: Tab, name: str) -> str:
    return f"""document.querySelector("[data-param='{name}'] input").value"""


def test_a_parameter_is_changed_and_checked(page: Tab, flown: Lab):
    name = "safety.virtual_cage.x"
    page.until(f"{value(page, name)} === '5.0'")
    enter(page, name, "4")
    page.reads(".safety", "x [-4, 4]")
    assert flown.quadctl("param", "get", name, "--json").json == {name: 4.0}
    enter(page, name, "0.1")
    page.reads(".q-notification.bg-negative", "0.2", within=20)
    page.until(f"{value(page, name)} === '4.0'")
    assert flown.quadctl("param", "set", name, 5).code == 0
    page.until(f"{value(page, name)} === '5.0'")


def test_every_table_of_parameters_can_be_looked_at(page: Tab):
    tabs = "[...document.querySelectorAll('.parameters .q-tab')]"
    for table, row in (
        ("pressure", "pressure.noise"),
        ("dynamics.control", "dynamics.control.max_jerk"),
        ("safety", "safety.takeoff"),
    ):
        page.js(f"{tabs}.find(tab => tab.textContent.trim() === '{table}').click()")
        page.until(f"!!document.querySelector(\"[data-param='{row}']\")")
    page.reads("[data-param='safety.takeoff']", "[0, 10000] m", "height of the first goal")


def test_a_killed_process_is_seen_and_can_be_restarted(page: Tab, flown: Lab):
    row = ".processes [data-node=pressure]"
    old = flown.signal("pressure", signal.SIGKILL)
    page.reads(row, "1 restart")
    flown.revived("pressure", old)
    now = flown.nodes()["pressure"]["pid"]
    page.reads(row, "ready", str(now))
    page.press(f"{row} button")
    flown.revived("pressure", now)
    page.reads(row, "ready", str(flown.nodes()["pressure"]["pid"]))
    page.reads(".journal", "process", f"in place of {now}")
    assert all(page.text(f".processes [data-node={node}]") for node in NODES)


def test_reset_begins_anew(page: Tab, flown: Lab):
    page.floor(1, 1)
    page.reads(".journal", "at (1, 1, 1)")
    page.press(".act.reset")
    eventually(lambda: position(flown)[:2] == (0.0, 0.0))
    page.reads(".journal", "boot")


def test_nothing_is_asked_of_any_other_machine(page: Tab, console: Console):
    here = urlsplit(console.control).netloc
    asked = {urlsplit(url) for url in page.requests}
    assert {url.netloc for url in asked if url.scheme in {"http", "https", "ws", "wss"}} == {here}
    assert {url.scheme for url in asked} <= {"http", "ws", "data", "blob", "about"}


def test_page_without_the_token_cannot_change_anything(
    console: Console, chromium: Browser, flown: Lab
):
    watching = chromium.tab(console.watch)
    watching.until(LIVE, 40)
    watching.reads(".top", "watching only")
    before = flown.quadctl("state", "--json").json
    pids = [node["pid"] for node in flown.nodes().values()]
    # Every event that the server has a listener for, with what a page that controls would send.
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
    after = flown.quadctl("state", "--json").json
    told = ("request", "boot", "cage_on", "cage", "goal", "reason")
    assert {name: after[name] for name in told} == {name: before[name] for name in told}
    assert [node["pid"] for node in flown.nodes().values()] == pids
    watching.close()


def test_a_phone_shows_it_without_sideways_scrolling(phone: Tab, page: Tab):
    assert phone.js("document.documentElement.scrollWidth") == PHONE[0]
    phone.press(".act.hold")
    phone.reads(".reason", "hold: stopped on request")
    page.reads(".reason", "hold: stopped on request")


def test_a_browser_that_takes_nothing_is_sent_no_more(phone: Tab, page: Tab):
    phone.js("""(() => {
        window.sent = 0;
        const live = getElement(Number(document.querySelector(".live").id.slice(1)));
        live.show = () => { window.sent += 1; return new Promise(() => {}); };
    })()""")
    phone.until("window.sent === 1")
    page.floor(-1, -1)
    page.reads(".journal", "at (-1, -1, 1)")
    assert phone.js("window.sent") == 1


def test_page_reports_a_lost_run_and_reconnects_by_itself(page: Tab, flown: Lab):
    assert flown.quadctl("down").code == 0
    page.until("document.body.dataset.link === 'lost'")
    page.reads(".banner", "nothing is running")
    page.press(".act.hold")
    page.reads(".q-notification:last-child", "not connected")
    flown.start(*SETTINGS)
    page.until(LIVE)
    page.floor(1, 0)
    page.reads(".journal", "at (1, 0, 1)")
