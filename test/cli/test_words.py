"""Private words stay out of the help, the README and the docs: one word for one thing, and it is the field's own."""

from __future__ import annotations

import argparse
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

from robot_ident.cli.main import VERBS, build_parser

INSTEAD = {
    # statistics and diagnosis
    r"loops? of doubt": "diagnosis loop",
    r"doubt(s|ed|ful)?": "diagnosis, vetoed, shows lack of fit",
    r"beyond (the )?noise": "excess rms (over the noise)",
    r"most telling": "most informative",
    r"telling": "informative",
    r"untold": "unidentifiable, unspecified",
    r"findings?": "finding",
    r"fellows?": "other selected effects",
    r"rivals?|tied": "indistinguishable alternatives, next candidate, second publisher",
    r"misfits?": "lack of fit",
    r"surely": "lower bound of the excess",
    r"faint(ly)?": "down-weighted",
    r"weighed": "weighted, whitened",
    r"foreseen": "cross-validation fold, predicted",
    r"no fit (has seen|sees)|unseen|kept aside": "validation (hold-out)",
    r"staircases?": "error history",
    r"falling error": "error reduction",
    r"beside": "next to, compared with, in addition to",
    r"look-?alikes?": "confusable effects",
    r"firm(er|ly)?": "conclusive",
    r"what stays": "unexplained excess",
    r"this day only": "excludes day-to-day variation",
    r"no links can have": "not physically consistent",
    r"gets no name": "not named: (reason)",
    r"vague(ly)?": "prior standard deviation",
    # physics and signals
    r"rattl\w*|shaken": "impact-excited",
    r"blows?": "impact",
    r"muted": "masked",
    r"bedding": "contact transition width",
    r"hidden paths?|kinks?": "unresolved motion at reversals",
    r"given way|gives way|yielded": "servo compliance",
    r"roughness": "position noise standard deviation",
    r"off the clock": "timestamp jitter",
    r"clipped": "saturated",
    r"set aside": "excluded",
    r"one pass": "non-periodic",
    r"counts? the other way round": "inverted sign",
    r"not yet built up": "presliding hysteresis",
    r"behind the gear": "link side",
    r"in ampere": "in amperes",
    r"no further, faster or elsewhere": "inside the recorded envelope",
    r"way in and out": "approach and stop",
    # program
    r"verbs?": "command",
    r"whole story": "end-to-end example",
    r"remembered": "cached",
    r"as told|unless told": "from (option), default",
    r"deeds?": "actions",
    r"held up": "delayed",
    r"leaps?": "jump",
    r"go(es)? on (where|from it|with)|gone on with": "resumes, continues",
    r"listens to this machine alone": "binds to localhost",
    r"eyes and a mouse": "web UI",
    r"take the # away": "uncomment",
}
"""Private words, as regular expressions, and what to write instead. Words with a plain meaning too are left out."""

_NAMES = re.compile(r"`[^`\n]+`|(?<!\w)--?[a-z][\w-]*")  # options, files, keys are a contract; outputs are quoted
_ROOT = Path(__file__).resolve().parents[2]
_PAGES = [_ROOT / "README.md", *sorted(page for page in (_ROOT / "docs").glob("*.md") if page.name != "glossary.md")]
_LONGEST = 25  # words of a sentence


def _blank(hit: re.Match[str]) -> str:
    return re.sub(r"\S", "`", hit[0])


def found(text: str, source: str) -> list[str]:
    """Return a line for every private word of a text."""
    plain = _NAMES.sub(_blank, text)
    hits = []
    for private, word in INSTEAD.items():
        pattern = re.compile(rf"\b({private})\b".replace(" ", r"\s+"), re.IGNORECASE)
        for hit in pattern.finditer(plain):
            hits.append((plain.count("\n", 0, hit.start()) + 1, " ".join(hit[0].split()), word))
        plain = pattern.sub(_blank, plain)  # a word of a phrase that was found is none of its own
    return [f"{said!r} in {source}:{line}: write {word!r}" for line, said, word in sorted(hits)]


def parser_of(command: str) -> argparse.ArgumentParser:
    """Return the parser of one command."""
    actions = build_parser(command)._actions
    commands = next(action for action in actions if isinstance(action, argparse._SubParsersAction))
    parser: argparse.ArgumentParser = commands.choices[command]
    return parser


def sentences(command: str) -> Iterator[str]:
    """Yield the sentences of a command's help."""
    parser = parser_of(command)
    for text in (parser.description, *(action.help for action in parser._actions)):
        yield from re.split(r"[.;:]\s", text or "")


def test_a_private_word_is_found_with_its_place_and_replacement() -> None:
    assert found("one\nthe Loop\nof doubt", "docs/x.md") == ["'Loop of doubt' in docs/x.md:2: write 'diagnosis loop'"]
    assert not found("`tied_with`, `misfit`, --fail-on-misfit, proverb, confirm", "docs/x.md")


def test_help_has_no_private_words() -> None:
    assert not found(build_parser("").format_help(), "robot_ident --help")


@pytest.mark.parametrize("command", VERBS)
def test_help_of_a_command_has_no_private_words(command: str) -> None:
    hits = found(parser_of(command).format_help(), f"robot_ident {command} --help")
    assert not hits, "\n".join(hits)


@pytest.mark.parametrize("command", VERBS)
def test_sentences_of_the_help_are_short(command: str) -> None:
    assert not [one for one in sentences(command) if len(one.split()) > _LONGEST]


@pytest.mark.parametrize("page", _PAGES, ids=lambda page: page.name)
def test_pages_have_no_private_words(page: Path) -> None:
    hits = found(page.read_text(encoding="utf-8"), str(page.relative_to(_ROOT)))
    assert not hits, "\n".join(hits)
