"""The page on safety shows the table as it is."""

from docs.diagram import diagram, table, words
from docs.draw import PAGE, drawn
from quadctl.services.safety.automaton import RULES


def test_the_page_is_the_tables():
    page = PAGE.read_text(encoding="utf-8")
    assert drawn(page) == page, "python -m docs.draw writes it anew"


def test_every_change_of_state_is_an_arrow_and_every_part_is_explained():
    arrows = {(rule.at.name, rule.to.name) for rule in RULES if rule.at is not rule.to}
    lines = [line.split() for line in diagram().splitlines() if " : " in line]
    assert {(line[0], line[2]) for line in lines} == arrows
    assert len(table().splitlines()) == len(RULES) + 2
    explained = dict(line.removeprefix("- ").split(": ", 1) for line in words().splitlines())
    assert all(explained.values())
    named = {part.__name__ for rule in RULES for part in (rule.on, rule.when, rule.do)}
    assert set(explained) == {f"`{name}`" for name in named}
