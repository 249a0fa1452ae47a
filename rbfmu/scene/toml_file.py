"""Read the tables of a scene file; invalid TOML raises a SceneError that says where the error is."""

import re
import tomllib
from itertools import dropwhile, takewhile
from pathlib import Path
from typing import Any

from rbfmu.scene.section import SceneError, as_toml, joined

LARGEST_FILE = 1_000_000
"""The largest size of a scene file in bytes; a typical file has a few hundred."""
LONGEST_COMMENT = 1000
"""The most characters of a comment that become a description."""
MAX_LINES = 100
"""The most lines of one statement."""
_TWICE = re.compile(r"Cannot (overwrite|declare)|twice")
_NOT_BOOLEAN = re.compile(r"=\s*(yes|no|on|off|true|false)\s*([#,}]|$)", re.IGNORECASE)
_UNIT = re.compile(r"(.*=\s*(?:[-+]?\d[\d_.]*(?:[eE][-+]?\d+)?|\[[^\]]*\]))\s*([^\W\d][^#]*)")
_TABLE = re.compile(r"\s*(\[\[?[^\]=]*\]\]?)\s*(#.*)?")


def read_file(path: Path) -> tuple[dict[str, Any], str]:
    """Return the file's tables, and its text. Raises SceneError."""
    try:
        with path.open("rb") as file:
            content = file.read(LARGEST_FILE + 1)
        if len(content) > LARGEST_FILE:
            raise SceneError(f"larger than {LARGEST_FILE} bytes: expected a scene in TOML", str(path))
        text = content.decode("utf-8-sig")
        return tomllib.loads(text), text
    except SceneError:
        raise
    except OSError as error:
        raise SceneError(f"cannot be read ({error.strerror}): expected a scene file in TOML", str(path)) from None
    except UnicodeDecodeError:
        raise SceneError("not a text file in UTF-8: expected a scene in TOML", str(path)) from None
    except RecursionError:
        raise SceneError("nested too deeply: expected a scene in TOML", str(path)) from None
    except tomllib.TOMLDecodeError as error:
        place = re.search(r"line (\d+)", str(error))
        if _TWICE.search(str(error)):
            _refuse_repeated_key(text.splitlines(), place, path)
        hint = _hint(text.split("\n"), place)
        raise SceneError(f"not TOML: {error}{hint}", str(path)) from None
    except ValueError as error:  # such as for a number with too many digits, or a wrong path
        raise SceneError(f"not TOML: {error}", str(path)) from None


def with_description(tables: dict[str, object], text: str, file_name: str) -> dict[str, object]:
    """Return the tables; if they have no description, the first paragraph of the file's comment becomes it."""
    about, comment = tables.get("about", {}), _first_paragraph(text, file_name)
    if not comment or not isinstance(about, dict) or "description" in about:
        return tables
    return tables | {"about": {"description": comment} | about}


def _first_paragraph(text: str, file_name: str) -> str:
    """Return the comment in the file's first lines, up to an empty one, as one line without the file's name."""
    lines = (line.removeprefix("#").strip() for line in takewhile(lambda line: line.startswith("#"), text.splitlines()))
    words = takewhile(bool, dropwhile(lambda line: line in ("", file_name), lines))
    return "".join(c for c in " ".join(words) if c.isprintable())[:LONGEST_COMMENT]


def _hint(lines: list[str], place: re.Match[str] | None) -> str:
    """Return the wrong line, and what to write instead of a value such as yes or True, or one with a unit."""
    if not place or not (line := lines[int(place[1]) - 1].strip()):
        return ""
    quoted = f": {as_toml(line)}" if line.isprintable() else ""
    if found := _NOT_BOOLEAN.search(line):
        return f"{quoted}: expected true or false in place of {found[1]}"
    if found := _UNIT.fullmatch(line.partition("#")[0].strip()):
        return f"{quoted}: expected {found[1].strip()} without a unit (SI; `rbfmu keys` lists them)"
    return quoted


def _refuse_repeated_key(lines: list[str], place: re.Match[str] | None, path: Path) -> None:
    """Raise a SceneError with a repeated key and its line, counted from 1; tomllib only reports the statement's end."""
    last = int(place[1]) if place else len(lines)
    before = range(last - 1, max(last - MAX_LINES, 0) - 1, -1)
    first = next((k for k in before if _parse_or_none(lines[:k]) is not None), last)
    while first < last and lines[first].split("#")[0].strip() == "":
        first += 1
    if statement := _parse_or_none(lines[first:last]):
        tables = [found[1] for line in lines[:first] if (found := _TABLE.fullmatch(line))]
        inside = tables and not _TABLE.fullmatch(lines[first])
        key = _dotted_key(_parse_or_none(tables[-1:]) if inside else {}, statement)
        expected = "expected each key and table once"
        raise SceneError(f"not TOML: {key} stands twice, again in line {first + 1}: {expected}", str(path)) from None


def _dotted_key(*nested: object) -> str:
    path = ""
    for tables in nested:
        while isinstance(tables, dict) and len(tables) == 1:
            key, tables = next(iter(tables.items()))
            path = joined(path, key)
            tables = tables[0] if isinstance(tables, list) and tables == [{}] else tables
    return path


def _parse_or_none(lines: list[str]) -> dict[str, object] | None:
    try:
        return tomllib.loads("\n".join(lines))
    except ValueError:
        return None
