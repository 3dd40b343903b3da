"""Expand abbreviations in problem files: named points, repeated motions and included problems.

`expand_abbreviations` changes the tree of the file before its values are checked. All following
code then sees a plain list of motions. Each part of the tree keeps the line of the file from which
it comes.
"""

from collections.abc import Mapping
from dataclasses import replace
from typing import Annotated, Any

from ssm_planner.errors import suggestion
from ssm_planner.loading.files import follow_reference
from ssm_planner.loading.schema import Model, quantity_reader, validate_section
from ssm_planner.loading.yaml_nodes import Node, Section, node_from_data
from ssm_planner.problem import Bound

LONGEST_MOTION = 10_000
"""Largest number of motions in a motion list after the expansion."""
CORNER_MOTIONS = ("straight", "line")
"""Keys of motions that may have corners, which the key `through` lists."""
POINT_KEYS = {
    "": ("start",),
    "scan": ("at",),
    "retina": ("to",),
    **dict.fromkeys(("free", "straight", "spline", "line", "arc"), ("to", "through")),
}
"""Keys that contain points, by the key of the motion."""


def expand_abbreviations(section: Section, within: tuple[Section, ...] = ()) -> Section:
    """Expand the named points, repetitions, inclusions and corners in a problem file.

    Parameters
    ----------
    section : Section
        Problem file.
    within : tuple of Section
        Problem files that include this one, from the outermost to the innermost.

    Returns
    -------
    Section
        The problem with a plain list of motions.

    Raises
    ------
    ProblemError
        If a name is unknown, a motion is incomplete, or a problem includes itself.
    """
    points = _named_points(section)
    children = dict(section.root.children)
    for key in ("start", "motion"):
        if key in children:
            children[key] = _replace_point_names(section.sub(key), children[key], points)
    if "motion" in children and isinstance(children["motion"].value, list):
        entries = _MotionExpansion(section, within).expand(
            section.sub("motion"), children["motion"]
        )
        children["motion"] = _replace_children(children["motion"], dict(enumerate(entries)))
    return Section(section.file, _replace_children(section.root, children))


def _replace_children(node: Node, children: Mapping[str | int, Node]) -> Node:
    """Return a copy of a mapping or list with other entries.

    Parameters
    ----------
    node : Node
        Node that is copied. Its keys keep their lines. New keys have the line of their value.
    children : mapping of Node
        New entries by key or list position.

    Returns
    -------
    Node
        The copy.
    """
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


def _named_points(section: Section) -> Mapping[str | int, Node]:
    """Return the named points of a problem, which its key `points` contains.

    Parameters
    ----------
    section : Section
        The problem file.

    Returns
    -------
    mapping of Node
        Parts of the file that describe the points, by name. Empty without the key.

    Raises
    ------
    ProblemError
        If the key does not contain a mapping of names to mappings.
    """
    if not section.has_key("points"):
        return {}
    root = section.root.children["points"]
    for path, node in (((), root), *(((name,), node) for name, node in root.children.items())):
        if not isinstance(node.value, dict):
            raise section.sub("points").error(
                "not a mapping of names to points",
                *path,
                allowed="such as {above: {tilt: -110 deg, depth: 5 mm}}",
            )
    return root.children


def _replace_point_names(
    part_section: Section, node: Node, points: Mapping[str | int, Node]
) -> Node:
    """Return a copy of a part of a file in which points replace their names.

    Parameters
    ----------
    part_section : Section
        Part of the file that the node represents.
    node : Node
        Tree of this part.
    points : Mapping
        Nodes of the named points by name.

    Returns
    -------
    Node
        The copy.

    Raises
    ------
    ProblemError
        If a name is unknown.
    """
    # The last two keys are, for example, "free" and "to". Positions in lists are left out.
    keys = [key for key in part_section.path if isinstance(key, str)]
    if keys[-1] in POINT_KEYS.get(keys[-2] if len(keys) > 1 else "", ()) and isinstance(
        node.value, str
    ):
        if node.value not in points:
            raise part_section.error(
                f"unknown name of a point{suggestion(node.value, map(str, points))}",
                allowed=", ".join(map(str, points)) or "a point, or a name that `points` defines",
            )
        return replace(points[node.value], line=node.line)
    children = {
        child_key: _replace_point_names(part_section.sub(child_key), child, points)
        for child_key, child in node.children.items()
    }
    return _replace_children(node, children) if children else node


def _split_at_corners(motion_section: Section, entry: Node) -> list[Node]:
    """Split a motion with corners into one motion to each corner and one to its end.

    The motions to the corners get the key `blend`, which rounds the corners.

    Parameters
    ----------
    motion_section : Section
        Part of the file that describes the motion, for messages.
    entry : Node
        Entry of the motion list with the single key `straight` or `line`.

    Returns
    -------
    list of Node
        Entries of the motion list without corners.

    Raises
    ------
    ProblemError
        If the corners or `blend` are invalid.
    """
    ((name, node),) = entry.children.items()
    corners = node.children.get("through")
    if corners is None or not isinstance(corners.value, list) or not corners.value:
        return [entry]
    if "blend" not in node.children:
        reason = "missing: corners need a distance within which they are rounded"
        raise motion_section.sub(name).error(reason, "blend", allowed="a length such as 0.3 mm")
    other_children: dict[str | int, Node] = {
        key: child for key, child in node.children.items() if key not in ("through", "to", "blend")
    }
    ends = [*corners.children.values(), *([node.children["to"]] if "to" in node.children else [])]
    motions = []
    for k, end in enumerate(ends):
        corner_keys: dict[str | int, Node] = (
            {"blend": node.children["blend"]} if k < len(corners.value) else {}
        )
        line_node = replace(
            _replace_children(node, {**other_children, "to": end, **corner_keys}), line=end.line
        )
        motions.append(
            replace(_replace_children(entry, {name: line_node}), key_lines={name: end.line})
        )
    return motions


class RepeatModel(Model):
    """Motions to repeat."""

    times: Annotated[
        Any, quantity_reader("number", Bound(at_least=1, at_most=LONGEST_MOTION), integer=True)
    ]
    """Number of repetitions."""
    motion: list[Any]
    """Motions to repeat, in order."""


class _MotionExpansion:
    """Expansion of the motion list of one problem."""

    def __init__(self, section: Section, within: tuple[Section, ...]) -> None:
        """Store the problem whose motion list is expanded.

        Parameters
        ----------
        section : Section
            The problem.
        within : tuple of Section
            Problems that include this one.
        """
        self.section = section
        self.within = within

    def expand(self, list_section: Section, node: Node) -> list[Node]:
        """Return the entries of a motion list without repetitions, inclusions and corners.

        Parameters
        ----------
        list_section : Section
            Part of the file with the motion list.
        node : Node
            Tree of this part.

        Returns
        -------
        list of Node
            Entries of the expanded list.

        Raises
        ------
        ProblemError
            If an entry is invalid or the list becomes too long.
        """
        expanded: list[Node] = []
        for i, entry in enumerate(node.children.values()):
            motion_section = list_section.sub(i)
            if set(entry.children) == {"repeat"}:
                expanded += self._repeat(motion_section.sub("repeat"), entry.children["repeat"])
            elif set(entry.children) == {"include"}:
                expanded += self._include(motion_section)
            elif len(entry.children) == 1 and next(iter(entry.children)) in CORNER_MOTIONS:
                expanded += _split_at_corners(motion_section, entry)
            else:
                expanded.append(entry)
            if len(expanded) > max(LONGEST_MOTION, i + 1):
                raise motion_section.error(
                    "too many motions", allowed=f"at most {LONGEST_MOTION} in all", show=False
                )
        return expanded

    def _repeat(self, list_section: Section, node: Node) -> list[Node]:
        """Return the motions of a `repeat` entry as often as it states.

        Parameters
        ----------
        list_section : Section
            Part of the file under the key `repeat`.
        node : Node
            Tree of this part.

        Returns
        -------
        list of Node
            Entries of the motion list.

        Raises
        ------
        ProblemError
            If there are more than `LONGEST_MOTION`.
        """
        times = validate_section(list_section, RepeatModel).times
        once = self.expand(list_section.sub("motion"), node.children["motion"])
        if times * len(once) > LONGEST_MOTION:
            raise list_section.error(
                "too many motions", allowed=f"at most {LONGEST_MOTION} in all", show=False
            )
        return times * once

    def _include(self, motion_section: Section) -> list[Node]:
        """Return the motions of an included problem.

        Messages about these motions refer to the line that includes the problem. Relative paths of
        tables are replaced by absolute ones.

        Parameters
        ----------
        motion_section : Section
            Entry of the motion list with the key `include`.

        Returns
        -------
        list of Node
            Entries of the motion list.

        Raises
        ------
        ProblemError
            If the problem has no motions or includes itself.
        """
        key = motion_section.sub("include")
        if not isinstance(key.value, str):
            raise key.error(
                "invalid problem", allowed="a problem file, relative to this one, or a shipped name"
            )
        included = follow_reference(motion_section, "include", file_kind="problem")
        chain = (*self.within, self.section)
        if included.file is not None and any(
            including.file is not None and including.file.samefile(included.file)
            for including in chain
        ):
            raise key.error("this problem includes itself", allowed="another problem")
        entries = (
            expand_abbreviations(included, chain).sub("motion").value
            if included.has_key("motion")
            else None
        )
        if not isinstance(entries, list):
            raise key.error("this problem has no motions", allowed="a problem with the key motion")
        for entry in entries:
            if (
                isinstance(entry, dict)
                and isinstance(entry.get("path"), str)
                and included.file is not None
            ):
                entry["path"] = str(included.file.parent.absolute() / entry["path"])
        return [node_from_data(entry, line=motion_section.line()) for entry in entries]
