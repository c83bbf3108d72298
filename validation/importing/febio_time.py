"""Load curves of FEBio: what they are worth at the end, which is the state that a case asks for."""

from __future__ import annotations

import numpy as np

from palpate.validation.importing.xml_tree import Element

# What FEBio calls equilibrium, by name and by number.
_STATIC = ("static", "0")


class LoadCurves:
    """Curves by their number, read at the end of the one step."""

    def __init__(self, sections: dict[str, list[Element]]) -> None:
        self.end_time = _end_time(sections.get("Control", []))
        self._curves: dict[str, Element] = {}
        for section in sections.get("LoadData", []):
            section.only("loadcurve", "load_controller")
            for curve in section:
                number = curve.require("id")
                if number in self._curves:
                    raise curve.refuse(f"load curve {number} is there twice")
                self._curves[number] = curve

    def factor(self, element: Element) -> float:
        """What an element's load curve multiplies it with at the end; 1 without one."""
        kind = element.attributes.get("type", "const")
        if (
            kind not in ("const", "vector")
            or "map" in element.attributes
            or "node_data" in element.attributes
        ):
            raise element.refuse(f"<{element.tag}> varies in place; a case has one number for it")
        number = element.attributes.get("lc")
        if number is None or number == "0":
            return 1.0
        if number not in self._curves:
            raise element.refuse(f"no load curve {number} in <LoadData>")
        return self._value(self._curves[number])

    def value(self, element: Element) -> float:
        """An element's number at the end."""
        return element.number() * self.factor(element)

    def _value(self, curve: Element) -> float:
        if curve.attributes.get("type", "loadcurve") not in (
            "loadcurve",
            "linear",
            "step",
            "smooth",
        ):
            raise curve.refuse(f"load controller {curve.attributes['type']!r} is no load curve")
        listed = curve.child("points") or curve
        rows = [point.numbers() for point in listed if point.tag in ("point", "pt", "loadpoint")]
        listed_wrong = [row for row in rows if len(row) != 2]
        if not rows or listed_wrong:
            raise curve.refuse("a load curve needs points of two numbers each")
        times, values = np.array(rows).T
        if not (np.diff(times) > 0.0).all():
            raise curve.refuse("the times of a load curve have to increase")
        end = self.end_time
        near = int(np.abs(times - end).argmin())
        if abs(times[near] - end) <= 1e-9 * max(abs(end), 1.0):
            return float(values[near])
        if end > times[-1] or end < times[0]:
            if _setting(curve, "extend", "constant") != "constant":
                raise curve.refuse(f"the curve ends before the step does, at {end:g}; extend it")
            return float(values[-1] if end > times[-1] else values[0])
        kind = _setting(curve, "interpolate", curve.attributes.get("type", "linear"))
        if kind not in ("linear", "loadcurve"):
            raise curve.refuse(f"a {kind} curve between its points; give it a point at {end:g}")
        return float(np.interp(end, times, values))


def _setting(curve: Element, tag: str, default: str) -> str:
    found = curve.child(tag)
    return (found.text if found is not None else curve.attributes.get(tag, default)).lower()


def _end_time(controls: list[Element]) -> float:
    """time_steps times step_size; 1 where nothing is said."""
    if len(controls) > 1:
        raise controls[1].refuse("<Control> is there twice; a case has one step")
    for control in controls:
        analysis = control.child("analysis")
        if analysis is not None:
            kind = analysis.attributes.get("type", analysis.text).lower()
            if kind not in (*_STATIC, "steady-state"):
                raise analysis.refuse(f"analysis {kind!r}: an import is of equilibrium (static)")
        steps, size = control.child("time_steps"), control.child("step_size")
        if steps is not None and size is not None:
            return steps.number() * size.number()
    return 1.0
