"""Parse YAML into a tree that knows the line of every key and value.

`parse_yaml` builds the tree of `Node` objects. A `Section` is a part of this tree, located by a
path of keys. It builds error messages with file, line and key. Data from Python become a tree
without lines (`node_from_data`), so that the same functions can read them.
"""

import math
import re
from collections.abc import Iterator, Mapping
from dataclasses import field
from pathlib import Path
from typing import Any

import yaml

from ssm_planner.errors import ProblemError
from ssm_planner.typing import frozen

LARGEST_TREE = 300_000
"""Largest number of values after expansion of aliases."""
LARGEST_DEPTH = 30
"""Largest number of nested levels in a YAML or JSON file."""

_INTEGER = re.compile(r"[-+]?[0-9]{1,18}")
_FLOAT = re.compile(r"[-+]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][-+]?[0-9]+)?")
_SPECIAL_WORDS: dict[str, object] = {
    spelling: value
    for spellings, value in (
        ("~ null Null NULL", None),
        ("true True TRUE", True),
        ("false False FALSE", False),
        (".nan .NaN .NAN", math.nan),
        (".inf .Inf .INF +.inf", math.inf),
        ("-.inf", -math.inf),
    )
    for spelling in spellings.split()
}
_STRING_TAGS = (
    None,
    "!",
    "tag:yaml.org,2002:str",
    "tag:yaml.org,2002:map",
    "tag:yaml.org,2002:seq",
)


@frozen
class Node:
    """Node of the tree of a YAML file: a mapping, a list or a single value."""

    value: Any
    """Value as Python data."""
    line: int | None
    """Line on which the value begins, counted from 1. None for data from Python."""
    size: int = 1
    """Number of values in the tree below and including this node, with aliases expanded."""
    children: "Mapping[str | int, Node]" = field(default_factory=dict)
    """Nodes of the entries, by key or list position."""
    key_lines: Mapping[str | int, int | None] = field(default_factory=dict)
    """Lines of the keys of the entries."""


def parse_yaml(
    file: Path | None,
    text: str,
    max_nodes: int = LARGEST_TREE,
    trailing: bool = False,
    tree: bool = True,
) -> Node:
    """Parse a YAML text that contains a single document, and build its tree.

    Parameters
    ----------
    file : Path or None
        File for messages.
    text : str
        Text of the file.
    max_nodes : int
        Largest number of values after expansion of aliases.
    trailing : bool
        True to allow empty documents at the end, as `ros2 topic echo` writes them.
    tree : bool
        False to omit the nodes below the root. Long files then need a third of the memory.

    Returns
    -------
    Node
        Root of the tree.

    Raises
    ------
    ProblemError
        If the text is not one valid document.
    """
    loader = getattr(yaml, "CBaseLoader", yaml.BaseLoader)
    try:
        return _TreeBuilder(file, yaml.parse(text, Loader=loader), max_nodes, tree).document(
            trailing
        )
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        line = None if mark is None else mark.line + 1
        message = " ".join(sentence for sentence in (error.context, error.problem) if sentence)
        if mark is not None and text[mark.index : mark.index + 1] == "\t":
            message = "a tab instead of spaces"
        raise ProblemError(f"not valid YAML: {message}", file=file, line=line) from None
    except yaml.reader.ReaderError as error:
        line = text.count("\n", 0, error.position) + 1
        character = (
            error.character
            if isinstance(error.character, int)
            else ord(error.character[:1] or "\0")
        )
        raise ProblemError(
            f"not a text file: character U+{character:04X}", file=file, line=line
        ) from None
    except yaml.YAMLError as error:
        raise ProblemError(f"not valid YAML: {error}", file=file) from None


class _TreeBuilder:
    """Builder of a tree from the events of a YAML parser.

    It limits depth and size, so that a small file with many aliases cannot exhaust the memory.
    """

    def __init__(
        self, file: Path | None, events: Iterator[Any], max_nodes: int, tree: bool
    ) -> None:
        """Store the events and the limits of the tree.

        Parameters
        ----------
        file : Path or None
            File for messages.
        events : iterator of yaml.Event
            Events of the parser, from the start of the stream.
        max_nodes : int
            Largest number of values after expansion of aliases.
        tree : bool
            False to omit the nodes below the root.
        """
        self.file = file
        self.largest = max_nodes
        self.tree = tree
        self.events = events
        self.anchors: dict[str, Node | None] = {}
        self.path: list[str | int] = []

    def document(self, trailing: bool) -> Node:
        """Build the tree of the only document of the text.

        Parameters
        ----------
        trailing : bool
            True to allow empty documents at the end.

        Returns
        -------
        Node
            Root of the tree.

        Raises
        ------
        ProblemError
            If there are several documents, or no document.
        """
        next(self.events)  # start of the stream
        event = next(self.events)
        if isinstance(event, yaml.StreamEndEvent):
            raise ProblemError("the file is empty", file=self.file, line=1)
        root = self.node(next(self.events), 0)
        next(self.events)  # end of the document
        while not isinstance(event := next(self.events), yaml.StreamEndEvent):
            if trailing and self.node(next(self.events), 0).value is None:
                next(self.events)  # end of an empty document
                continue
            raise self.error(
                "a second document starts here", event, "one document per file, without '---' lines"
            )
        return root

    def node(self, event: Any, depth: int, *key: str | int) -> Node:
        """Build the node that starts with an event.

        Parameters
        ----------
        event : yaml.Event
            First event of the node.
        depth : int
            Number of levels above the node.
        *key : str or int
            Key or list position of the node. The root does not have one.

        Returns
        -------
        Node
            The node with all nodes below it.

        Raises
        ------
        ProblemError
            If the node is too deep, too large, or not plain YAML.
        """
        self.path[depth - 1 :] = key
        if depth > LARGEST_DEPTH:
            raise self.error("nested too deeply", event, f"at most {LARGEST_DEPTH} levels")
        if isinstance(event, yaml.AliasEvent):
            if event.anchor not in self.anchors:
                raise self.error(f"*{event.anchor} has no anchor above it", event)
            target = self.anchors[event.anchor]
            if target is None:
                raise self.error(f"*{event.anchor} is inside the value that it stands for", event)
            return target
        if event.tag not in _STRING_TAGS:
            raise self.error(f"the tag {event.tag} is not allowed", event, "plain values")
        if event.anchor is not None:
            self.anchors[event.anchor] = None
        if isinstance(event, yaml.ScalarEvent):
            node = Node(_parse_scalar(event), _line_number(event))
        elif isinstance(event, yaml.SequenceStartEvent):
            node = self.sequence(event, depth)
        else:
            node = self.mapping(event, depth)
        if node.size > self.largest:
            raise self.error(
                "too many values", event, f"at most {self.largest} in one file, aliases expanded"
            )
        if event.anchor is not None:
            self.anchors[event.anchor] = node
        return node

    def sequence(self, start: Any, depth: int) -> Node:
        """Build the node of a list.

        Parameters
        ----------
        start : yaml.SequenceStartEvent
            Event at the beginning of the list.
        depth : int
            Number of levels above the list.

        Returns
        -------
        Node
            The node with all nodes below it.
        """
        values: list[Any] = []
        size = 1
        children: dict[str | int, Node] = {}
        while not isinstance(event := next(self.events), yaml.SequenceEndEvent):
            item = self.node(event, depth + 1, len(values))
            if self.tree:
                children[len(values)] = item
            values.append(item.value)
            size += item.size
        return Node(
            values,
            _line_number(start),
            size,
            children,
            {i: item.line for i, item in children.items()},
        )

    def mapping(self, start: Any, depth: int) -> Node:
        """Build the node of a mapping.

        Parameters
        ----------
        start : yaml.MappingStartEvent
            Event at the beginning of the mapping.
        depth : int
            Number of levels above the mapping.

        Returns
        -------
        Node
            The node with all nodes below it.

        Raises
        ------
        ProblemError
            If a key occurs twice, or if it is not a plain word.
        """
        children: dict[str | int, Node] = {}
        key_lines: dict[str | int, int] = {}
        while not isinstance(event := next(self.events), yaml.MappingEndEvent):
            if not isinstance(event, yaml.ScalarEvent) or event.tag not in _STRING_TAGS:
                raise self.error("a key must be a plain word", event)
            key = event.value
            if key in children:
                raise ProblemError(
                    f"duplicate key (first on line {key_lines[key]})",
                    file=self.file,
                    line=_line_number(event),
                    key=format_path((*self.path[:depth], key)),
                    allowed="each key once",
                )
            key_lines[key] = _line_number(event)
            children[key] = self.node(next(self.events), depth + 1, key)
        values = {key: child.value for key, child in children.items()}
        size = 1 + sum(child.size for child in children.values())
        return Node(
            values, _line_number(start), size, *((children, key_lines) if self.tree else ())
        )

    def error(self, reason: str, event: Any, allowed: str | None = None) -> ProblemError:
        """Build a ProblemError at the line of an event."""
        return ProblemError(reason, file=self.file, line=_line_number(event), allowed=allowed)


def _parse_scalar(event: Any) -> object:
    """Convert a scalar to a Python value by the rules of YAML 1.2.

    For example, `1e-5` is a number, and `yes`, `no`, `on`, `off` and `1:30` are texts.

    Parameters
    ----------
    event : yaml.ScalarEvent
        Event of the parser with the text of the scalar.

    Returns
    -------
    int, float, bool, str or None
        The value. A quoted scalar is always a text.
    """
    text: str = event.value
    if event.style or event.tag == "tag:yaml.org,2002:str":
        return text
    if text in _SPECIAL_WORDS or not text:
        return _SPECIAL_WORDS.get(text)
    if _INTEGER.fullmatch(text):
        return int(text)
    if _FLOAT.fullmatch(text):
        return float(text)
    return text


def _line_number(event: Any) -> int:
    """Return the line of an event, counted from 1."""
    return int(event.start_mark.line) + 1


@frozen
class Section:
    """Part of a file, which is located by a path of keys and list positions."""

    file: Path | None
    """File, or None for data from Python."""
    root: Node
    """Root of the tree of the whole file."""
    path: tuple[str | int, ...] = ()
    """Keys and list positions that lead from the root to this part."""

    @property
    def name(self) -> str:
        """Name of the file without its suffix."""
        return "problem" if self.file is None else self.file.stem

    @property
    def file_name(self) -> str | None:
        """Name of the file, or None for data from Python."""
        return None if self.file is None else str(self.file)

    @property
    def value(self) -> Any:
        """Value of this part as the YAML parser returns it, without conversion."""
        return self._locate(())[1].value

    def sub(self, *path: str | int) -> "Section":
        """Return the part of the file at a path below this section.

        The path need not exist. Messages then refer to its deepest existing part.
        """
        return Section(self.file, self.root, (*self.path, *path))

    def has_key(self, key: str | int) -> bool:
        """Return True if this part of the file has an entry with this key or list position."""
        _, node, complete = self._locate(())
        return complete and key in node.children

    def line(self, *path: str | int) -> int | None:
        """Return the line, counted from 1, of a key or list entry at a path below this section."""
        return self._locate(path)[0]

    def error(
        self, reason: str, *path: str | int, allowed: str | None = None, show: bool = True
    ) -> ProblemError:
        """Build a ProblemError with the file, the line and the key of a path below this section.

        Parameters
        ----------
        reason : str
            Fault.
        *path : str or int
            Keys and list positions that lead to the faulty entry.
        allowed : str, optional
            Description of the allowed values.
        show : bool
            True if the message also contains the value.
        """
        line, node, complete = self._locate(path)
        value = _original_text(node.value) if complete and show else None
        key = format_path((*self.path, *path)) or None
        return ProblemError(
            reason, file=self.file, line=line, key=key, value=value, allowed=allowed
        )

    def _locate(self, path: tuple[str | int, ...]) -> tuple[int | None, Node, bool]:
        """Find the node at a path below this section.

        Parameters
        ----------
        path : tuple of str and int
            Keys and list positions.

        Returns
        -------
        line : int or None
            Line of the key. If the path does not exist, line and node are those of its deepest
            existing part.
        node : Node
            Node at the path.
        exists : bool
            True if the path exists.
        """
        node = self.root
        line = self.root.line
        for key in (*self.path, *path):
            if key not in node.children:
                return line, node, False
            line = node.key_lines[key]
            node = node.children[key]
        return line, node, True


def format_path(path: tuple[str | int, ...]) -> str:
    """Format a path, for example ("motion", 2, "tilt", "to") as `motion[2].tilt.to`.

    List positions count from 0.
    """
    text = ""
    for key in path:
        text += f"[{key}]" if isinstance(key, int) else ("." if text else "") + key
    return text


def node_from_data(data: Any, depth: int = 0, line: int | None = None) -> Node:
    """Convert data from Python to a tree.

    Parameters
    ----------
    data : object
        Mappings, lists and single values.
    depth : int
        Number of levels above the data.
    line : int, optional
        Line that all values get. The default is None.

    Returns
    -------
    Node
        Root of the tree.

    Raises
    ------
    ProblemError
        If there are too many levels.
    """
    if depth > LARGEST_DEPTH:
        raise ProblemError("nested too deeply", allowed=f"at most {LARGEST_DEPTH} levels")
    items: dict[str | int, Any]
    if isinstance(data, Mapping):
        items = {str(key): item for key, item in data.items()}
    elif isinstance(data, (list, tuple)):
        items = dict(enumerate(data))
    else:
        return Node(data, line)
    children = {key: node_from_data(item, depth + 1, line) for key, item in items.items()}
    values = {key: child.value for key, child in children.items()}
    value = values if isinstance(data, Mapping) else list(values.values())
    return Node(value, line, 1, children, dict.fromkeys(children, line))


def _original_text(value: object) -> str | None:
    """Format a value as the user wrote it, for messages.

    The result is None for a mapping. A mapping with the key `value`, which is a quantity with its
    source, is an exception: It gives the text of the quantity.
    """
    if isinstance(value, dict):
        return _original_text(value["value"]) if "value" in value else None
    if isinstance(value, list):
        return "[" + ", ".join(_original_text(item) or "{…}" for item in value) + "]"
    if value is None:
        return "null"
    return value if isinstance(value, str) else repr(value)
