"""What a problem file says in short, written out: names of points, repeated motions, motions of other problems."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from ssm_planner.loading.files import follow
from ssm_planner.loading.yaml_nodes import Node, Section, plain_node

LONGEST_MOTION = 10_000
_CURVES = {
    "spline": ("to", "through"),
    "line": ("to", "through"),
    "arc": ("to", "through"),
    "retina": ("to",),
}
CORNERED = ("straight", "line")
"""Motions that may have corners on their way."""
PLACES = {
    "": ("start",),
    "free": ("to", "through"),
    "straight": ("to", "through"),
    "scan": ("at",),
    **_CURVES,
}
"""Keys that hold points, by what they are keys of."""


def written_out(section: Section, within: tuple[Section, ...] = ()) -> Section:
    """The section of a problem with its points in the place of their names, and every motion in its list by itself.

    within: those that include this one. Raises ProblemError.
    """
    points, children = _points(section), dict(section.root.children)
    for key in ("start", "motion"):
        if points and key in children:
            children[key] = _with_points(section.sub(key), children[key], points)
    if "motion" in children and isinstance(children["motion"].value, list):
        entries = _Motions(section, within).of(section.sub("motion"), children["motion"])
        children["motion"] = _replaced(children["motion"], dict(enumerate(entries)))
    return Section(section.file, _replaced(section.root, children))


def _replaced(node: Node, children: Mapping[str | int, Node]) -> Node:
    """The node with other values below."""
    values = {key: child.value for key, child in children.items()}
    lines = {key: node.key_lines.get(key, child.line) for key, child in children.items()}
    if isinstance(node.value, list):
        lines = {key: child.line for key, child in children.items()}
    return replace(
        node,
        value=list(values.values()) if isinstance(node.value, list) else values,
        children=children,
        key_lines=lines,
    )


def _points(section: Section) -> Mapping[str | int, Node]:
    """The points that the problem names."""
    here = section.sub("points")
    if not section.holds("points"):
        return {}
    if not isinstance(here.value, dict):
        raise here.error(
            "not a mapping of names to points",
            allowed="such as {above: {tilt: -110 deg, depth: 5 mm}}",
        )
    points = section.root.children["points"].children
    for name, node in points.items():
        if not isinstance(node.value, dict):
            raise here.error("not a point", name, allowed="such as {tilt: -110 deg, depth: 5 mm}")
    return points


def _with_points(here: Section, node: Node, points: Mapping[str | int, Node]) -> Node:
    """The node with points in the place of their names. Raises ProblemError for a name that is none."""
    keys = [key for key in here.path if isinstance(key, str)]
    if keys[-1] in PLACES.get(keys[-2] if len(keys) > 1 else "", ()) and isinstance(
        node.value, str
    ):
        if node.value not in points:
            raise here.error("no point of this name", allowed=", ".join(map(str, points)))
        return replace(points[node.value], line=node.line)
    children = {
        part: _with_points(here.sub(part), child, points) for part, child in node.children.items()
    }
    return _replaced(node, children) if children else node


def _by_corners(place: Section, entry: Node) -> list[Node]:
    """A motion with corners on its way as one motion from each to the next, corners rounded. Raises ProblemError."""
    ((name, node),) = entry.children.items()
    corners = node.children.get("through")
    if corners is None or not isinstance(corners.value, list) or not corners.value:
        return [entry]
    if "blend" not in node.children:
        reason = "missing: the distance of the tip from a corner within which it is rounded"
        raise place.sub(name).error(reason, "blend", allowed="a length such as 0.3 mm")
    rest: dict[str | int, Node] = {
        key: child for key, child in node.children.items() if key not in ("through", "to", "blend")
    }
    ends = [*corners.children.values(), *([node.children["to"]] if "to" in node.children else [])]
    found = []
    for k, end in enumerate(ends):
        on: dict[str | int, Node] = (
            {"blend": node.children["blend"]} if k < len(corners.value) else {}
        )
        one = replace(_replaced(node, {**rest, "to": end, **on}), line=end.line)
        found.append(replace(_replaced(entry, {name: one}), key_lines={name: end.line}))
    return found


class _Motions:
    """The motions of a list one by one."""

    def __init__(self, section: Section, within: tuple[Section, ...]) -> None:
        self.section, self.within = section, within

    def of(self, here: Section, node: Node) -> list[Node]:
        """Of the list at a place of the file. Raises ProblemError."""
        found: list[Node] = []
        for i, entry in enumerate(node.children.values()):
            place = here.sub(i)
            if set(entry.children) == {"repeat"}:
                found += self._repeated(place.sub("repeat"), entry.children["repeat"])
            elif set(entry.children) == {"include"}:
                found += self._included(place)
            elif len(entry.children) == 1 and next(iter(entry.children)) in CORNERED:
                found += _by_corners(place, entry)
            else:
                found.append(entry)
            if len(found) > max(LONGEST_MOTION, i + 1):
                raise place.error(
                    "too many motions", allowed=f"at most {LONGEST_MOTION} in all", show=False
                )
        return found

    def _repeated(self, here: Section, node: Node) -> list[Node]:
        value = node.value
        if not isinstance(value, dict) or set(value) != {"times", "motion"}:
            raise here.error(
                "not a repeated motion",
                allowed="{times: 3, motion: [- tilt: {to: -120 deg}, …]}",
                show=False,
            )
        times = value["times"]
        if type(times) is not int or not 1 <= times <= LONGEST_MOTION:
            raise here.error(
                "not how often", "times", allowed=f"a whole number from 1 to {LONGEST_MOTION}"
            )
        if not isinstance(value["motion"], list):
            raise here.error("not a list of motions", "motion", show=False)
        once = self.of(here.sub("motion"), node.children["motion"])
        if times * len(once) > LONGEST_MOTION:
            raise here.error(
                "too many motions", allowed=f"at most {LONGEST_MOTION} in all", show=False
            )
        return times * once

    def _included(self, place: Section) -> list[Node]:
        """The motions of another problem, for messages all in the line that includes it."""
        key = place.sub("include")
        if not isinstance(key.value, str):
            raise key.error(
                "not a problem", allowed="a problem file, relative to this one, or a shipped name"
            )
        other = follow(place, "include", kind="problem")
        chain = (*self.within, self.section)
        if other.file is not None and any(
            each.file is not None and each.file.samefile(other.file) for each in chain
        ):
            raise key.error("this problem includes itself", allowed="another problem")
        entries = written_out(other, chain).sub("motion").value if other.holds("motion") else None
        if not isinstance(entries, list):
            raise key.error(
                "this problem has no list of motions", allowed="a problem with the key motion"
            )
        for entry in entries:
            if (
                isinstance(entry, dict)
                and isinstance(entry.get("path"), str)
                and other.file is not None
            ):
                entry["path"] = str(other.file.parent.absolute() / entry["path"])
        return [plain_node(entry, line=place.line()) for entry in entries]
