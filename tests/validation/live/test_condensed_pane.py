"""The condensed pane is where the linear one comes to rest, under tool and grip at once."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from palpate.meshes.errors import InputError
from palpate.meshes.problem import Element
from palpate.validation.case import load_case
from palpate.validation.live.bench_touch import connected
from palpate.validation.live.live_case import Touch, live_case
from palpate.validation.live.panes import ExplicitPane, Surface, condensed_words, make_panes
from palpate.validation.live.recording import make_grip

BALL = {"shape": "sphere", "radius": 16.0}


@pytest.mark.parametrize("element", list(Element))
def test_it_is_where_the_linear_pane_comes_to_rest(element: Element) -> None:
    live = live_case(load_case("block"), Touch(BALL, mass_damping=100.0), (element,))
    panes = make_panes(live.problem, Surface(live.problem), (element,), is_condensed=True)
    linear, green, condensed = panes
    assert "condensed" in condensed.name
    assert isinstance(green, ExplicitPane)
    position = 1e-3 * (live.start - [5.0, 1.0, 0.0])
    anchor = 1e-3 * np.array([1.0, -2.0, 1.5])
    spring = make_grip(live, green, 3, 0.014, largest_way=1.0, digits=6).spring
    for pane in (linear, condensed):
        pane.attach(spring)
        for _ in range(400):
            pane.advance(position, anchor, live.clock.steps)
    linear.mean_force()
    linear.advance(position, anchor, live.clock.steps)
    u = condensed.displacement
    assert np.abs(linear.displacement - u).max() < 1e-9 * np.abs(u).max()
    for same in (
        lambda pane: pane.mean_force(),
        lambda pane: pane.pull(),
        lambda pane: pane.positions(),
        lambda pane: pane.shades("displacement"),
        lambda pane: pane.shades("stress"),
        lambda pane: pane.volume_change(pane.positions()),
        lambda pane: pane.strain_energy(),
    ):
        expected = np.asarray(same(linear))
        assert np.abs(expected).max() > 0.0
        assert np.abs(same(condensed) - expected).max() < 1e-7 * np.abs(expected).max()
    assert condensed.mean_force()[0] > 0.1
    condensed.reset()
    condensed.advance(1e-3 * live.start, None, 1)
    assert not condensed.displacement.any()
    assert not condensed.pull().any()


def test_the_page_has_it_without_the_cases_loads(serving) -> None:
    touch = Touch(BALL, mass_damping=100.0, is_condensed=True)
    with serving("block", touch) as server, connected(server.address) as client:
        assert client.scene["panes"][-1] == "linear strain (condensed)"
        x, y, z = client.scene["tool"]["start"]
        client.say("tool", number=1, to=[x - 5.0, y, z])
        forces = [pane["force"][0] for pane in client.until_time(1.8)["panes"]]
        assert forces[2] == pytest.approx(forces[0], rel=0.02)
        client.say("loads", on=True)
        note = client.until(lambda heard: heard.get("kind") == "note")
        assert "tool and spring alone" in note["text"]
        after = client.until_time(1.9)["panes"][2]["force"]
        assert after[0] == pytest.approx(forces[2])


def test_its_memory_is_stated_beforehand() -> None:
    words = condensed_words(load_case("kidney").problem, Element.LINEAR)
    assert "touched" in words
    assert "MB while it is made" in words


def test_a_support_that_moves_is_refused() -> None:
    problem = live_case(load_case("block"), Touch(BALL), (Element.LINEAR,)).problem
    (support,) = problem.supports
    moved = dataclasses.replace(support, displacement=(1e-3, 0.0, 0.0))
    with pytest.raises(InputError, match="supports stand still"):
        make_panes(
            dataclasses.replace(problem, supports=(moved,)),
            Surface(problem),
            (Element.LINEAR,),
            is_condensed=True,
        )
