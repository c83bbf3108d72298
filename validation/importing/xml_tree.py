"""XML that others wrote, as a tree that knows the line of each element.

Plain XML alone: a document type, and with it every entity that could grow or lead elsewhere, is
refused, and so are files and depths beyond what a model needs. Nothing is fetched.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from xml.parsers import expat

from palpate.meshes.untrusted import open_plain
from palpate.validation.importing.model import ImportRefusedError, Source, finite, whole

MOST_BYTES = 128 * 1024**2
_DEEPEST = 50
# Two million cells with their nodes and faces; their tree takes about 2 GB.
MOST_ELEMENTS = 2_500_000


class Element:
    """A tag with its attributes, its children and the text between them."""

    __slots__ = ("attributes", "children", "line", "parts", "path", "tag")

    def __init__(self, path: Path, tag: str, attributes: dict[str, str], line: int) -> None:
        self.path, self.tag, self.attributes, self.line = path, tag, attributes, line
        self.children: list[Element] = []
        self.parts: list[str] = []

    @property
    def source(self) -> Source:
        """The element's file and line."""
        return Source(self.path, self.line)

    @property
    def text(self) -> str:
        """The element's own text, trimmed."""
        return "".join(self.parts).strip()

    def __iter__(self) -> Iterator[Element]:
        return iter(self.children)

    def child(self, tag: str) -> Element | None:
        """The child of that tag, if there is one.

        Raises:
            ImportRefusedError: There are several.
        """
        found = [child for child in self if child.tag == tag]
        if len(found) > 1:
            raise found[1].refuse(f"<{tag}> is there twice; give it once")
        return found[0] if found else None

    def word(self, tag: str, attribute: str, default: str = "") -> str:
        """The text of the child of that tag, or else an attribute, by version of the format."""
        found = self.child(tag)
        return self.attributes.get(attribute, default) if found is None else found.text

    def require(self, name: str) -> str:
        """An attribute that has to be there."""
        if name not in self.attributes:
            raise self.refuse(f"<{self.tag}> needs the attribute {name}")
        return self.attributes[name]

    def id(self) -> int:
        """The attribute id, a whole number."""
        return whole(self.require("id"), self.source, f"<{self.tag} id=...>")

    def refuse(self, reason: str) -> ImportRefusedError:
        """The error that names the element's line."""
        return self.source.refuse(reason)

    def _words(self, text: str | None) -> list[str]:
        return (self.text if text is None else text).replace(",", " ").split()

    def numbers(self, text: str | None = None) -> list[float]:
        """The element's text, or another, as numbers separated by commas or spaces."""
        return [finite(word, self.source, f"<{self.tag}>") for word in self._words(text)]

    def wholes(self, text: str | None = None) -> list[int]:
        """The element's text, or another, as whole numbers."""
        return [whole(word, self.source, f"<{self.tag}>") for word in self._words(text)]

    def number(self) -> float:
        """The element's text as one number."""
        found = self.numbers()
        if len(found) != 1:
            raise self.refuse(f"<{self.tag}>: needs one number, has {self.text[:40]!r}")
        return found[0]

    def flag(self, tag: str) -> bool:
        """Whether the child of that tag is there with another number than 0."""
        found = self.child(tag)
        return found is not None and found.number() != 0.0

    def vector(self, text: str | None = None) -> tuple[float, float, float]:
        """The element's text as three numbers."""
        found = self.numbers(text)
        if len(found) != 3:
            raise self.refuse(f"<{self.tag}>: needs three numbers, has {len(found)}")
        return found[0], found[1], found[2]

    def only(self, *tags: str) -> None:
        """Refuse children beside these."""
        for child in self.children:
            if child.tag not in tags:
                known = ", ".join(tags) or "nothing"
                raise child.refuse(f"<{child.tag}> in <{self.tag}> is not known here ({known} is)")

    def only_attributes(self, *names: str) -> None:
        """Refuse attributes beside these."""
        for name in self.attributes:
            if name not in names:
                raise self.refuse(f"<{self.tag} {name}=...> is not known here")


def read_xml(path: Path) -> Element:
    """The root of an XML file.

    Raises:
        FileFormatError: Missing, no plain file, or too large.
        ImportRefusedError: Not XML, cut off, with a document type, or nested too deep.
    """
    with open_plain(path, most_bytes=MOST_BYTES) as stream:
        data = stream.read()
    # Counted before they take memory; a few may stand in comments.
    count = data.count(b"<") - data.count(b"</")
    if count > MOST_ELEMENTS:
        raise ImportRefusedError(
            path, None, f"{count} elements of XML; at most {MOST_ELEMENTS} are read"
        )
    parser = expat.ParserCreate()
    parser.buffer_text = True
    stack: list[Element] = []
    roots: list[Element] = []

    def refuse(reason: str) -> ImportRefusedError:
        return ImportRefusedError(path, parser.CurrentLineNumber, reason)

    def start(tag: str, attributes: dict[str, str]) -> None:
        if len(stack) >= _DEEPEST:
            raise refuse(f"nested more than {_DEEPEST} deep")
        element = Element(path, tag, attributes, parser.CurrentLineNumber)
        (stack[-1].children if stack else roots).append(element)
        stack.append(element)

    def text(piece: str) -> None:
        if stack:
            stack[-1].parts.append(piece)

    def document_type(*_about: object) -> None:
        raise refuse("a document type (<!DOCTYPE or <!ENTITY); take it out")

    parser.StartElementHandler = start
    parser.EndElementHandler = lambda _tag: stack.pop()
    parser.CharacterDataHandler = text
    parser.StartDoctypeDeclHandler = document_type
    parser.EntityDeclHandler = document_type
    try:
        parser.Parse(data, True)
    except expat.ExpatError as error:
        reason = expat.ErrorString(error.code)
        raise ImportRefusedError(path, error.lineno, f"cannot be read as XML ({reason})") from error
    # An encoding that Python does not know, or a name with half a character in it.
    except (LookupError, ValueError) as error:
        if isinstance(error, ImportRefusedError):
            raise
        raise ImportRefusedError(path, None, f"cannot be read as XML ({error})") from error
    return roots[0]
