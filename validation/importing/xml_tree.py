"""XML that others wrote, as a tree that knows the line of each element.

Plain XML alone: a document type, and with it every entity that could grow or lead elsewhere, is
refused, and so are files and depths beyond what a model needs. Nothing is fetched.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from xml.parsers import expat

from palpate.meshes.untrusted import open_plain
from palpate.validation.importing.model import ImportRefusedError, finite, whole
from palpate.validation.importing.understood import DATA, Statement

MOST_BYTES = 128 * 1024**2
_DEEPEST = 50
# Two million cells with their nodes and faces; their tree takes about 2 GB.
MOST_ELEMENTS = 2_500_000


class Element(Statement):
    """A tag with its attributes, its children and the text between them."""

    __slots__ = ("children", "parts", "tag")

    def __init__(self, path: Path, tag: str, attributes: dict[str, str], line: int) -> None:
        super().__init__(path, line, attributes)
        self.tag = tag
        self.children: list[Element] = []
        self.parts: list[str] = []

    @property
    def name(self) -> str:
        """Its tag."""
        return self.tag

    def shown(self, value: str = "") -> str:
        """<tag> or <tag value=...>."""
        return f"<{self.tag} {value}=...>" if value else f"<{self.tag}>"

    def below(self) -> list[Element]:
        """Its children."""
        return self.children

    def refuse_data(self, known: frozenset[str]) -> None:
        """Refuse text that nobody asked for and that is not harmless."""
        text = "".join(self.parts).strip()
        if text and f"{DATA}={text}" not in known:
            raise self.refuse(f"text in <{self.tag}> that is not known here: {text[:40]!r}")

    @property
    def text(self) -> str:
        """The element's own text, trimmed."""
        self.mark(DATA)
        return "".join(self.parts).strip()

    def each(self, *tags: str) -> Iterator[Element]:
        """Its children of these tags, or all of them, which then count as understood."""
        for child in self.children:
            if not tags or child.tag in tags:
                child.mark()
                yield child

    def child(self, tag: str) -> Element | None:
        """The child of that tag, if there is one.

        Raises:
            ImportRefusedError: There are several.
        """
        found = list(self.each(tag))
        if len(found) > 1:
            raise found[1].refuse(f"<{tag}> is there twice; give it once")
        return found[0] if found else None

    def said(self, tag: str, default: str = "") -> str:
        """The text of the child of that tag, where there is one."""
        found = self.child(tag)
        return default if found is None else found.text

    def id(self) -> int:
        """The attribute id, a whole number."""
        return whole(self.word("id"), self.source, f"<{self.tag} id=...>")

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


class PlainElement(Element):
    """One whose numbers are separated by spaces alone: a comma ends them."""

    __slots__ = ()

    def _words(self, text: str | None) -> list[str]:
        return (self.text if text is None else text).split()


def read_xml(path: Path, kind: type[Element] = Element) -> Element:
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
        element = kind(path, tag, attributes, parser.CurrentLineNumber)
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
