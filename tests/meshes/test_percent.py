"""Progress in per cent: silent while work is quick, rarer the longer it takes."""

from __future__ import annotations

import pytest

from palpate.fastsim.mesher import mesh_surface
from palpate.meshes.percent import Percent
from palpate.meshes.shapes import shape_sphere


class Clock:
    now = 0.0

    def __call__(self) -> float:
        return self.now


def test_quick_work_says_nothing_and_long_work_ever_less() -> None:
    clock, lines = Clock(), list[str]()
    percent = Percent(lines.append, clock)
    for step in range(20):
        clock.now = 0.099 * step
        percent("reading", step / 20)
    assert lines == []
    # Another stage begins its own two seconds. 1000 s, called ten times a second.
    for step in range(10_000):
        clock.now = 2.0 + 0.1 * step
        percent("improving", step / 10_000)
    assert lines[0] == "improving: 0 %"
    assert lines[-1].startswith("improving: 9")
    # After 2, 6, 14 and 30 s, then every 30 s.
    assert len(lines) == 4 + 32
    shares = [int(line.split()[1]) for line in lines]
    assert shares == sorted(shares)
    percent("improving", 7.0)
    clock.now += 100.0
    percent("improving", 7.0)
    assert lines[-1] == "improving: 99 %"


def test_every_stage_of_the_mesher_says_its_part(monkeypatch: pytest.MonkeyPatch) -> None:
    seen: dict[str, list[float]] = {}

    class Noted(Percent):
        def __call__(self, stage: str, done: float) -> None:
            seen.setdefault(stage, []).append(done)

    monkeypatch.setattr("palpate.fastsim.mesher.Percent", Noted)
    for edge in (0.002, 0.0014, 0.001):
        seen.clear()
        mesh_surface(shape_sphere(0.05, edge_length=edge))
        # Stages are asked several times a second: a fast machine is through with a small mesh.
        if len(seen["improving cells"]) > 1:
            break
    assert {"inserting points", "improving cells"} <= set(seen)
    for shares in seen.values():
        assert shares == sorted(shares)
        assert shares[0] == 0.0
        assert shares[-1] <= 1.0
    assert 0.0 < max(seen["improving cells"]) < 1.0
