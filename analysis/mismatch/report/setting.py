"""Words that fit the bench: a finger under a lever, another specimen under a lever, or another instrument."""

from __future__ import annotations

import re
from dataclasses import replace

from analysis.mismatch.report.contents import Report
from analysis.mismatch.study.intake import Setting

_SPECIMEN = (
    (r"breathing moves the hand and with it the skin", "breathing moves the specimen"),
    (r"the hand trembles: the skin moves", "the specimen trembles: it moves"),
    (r"finger pad|fingers?\b(?! study)|skin", "specimen"),
    (r"tissues", "specimens"),
    (r"tissue", "specimen"),
    (r"punch", "indenter"),
)
_DRIVE = (
    (r"bearing", "drive"),
    # the names of mechanisms stay what they are
    (r"\blever\b(?! (?:compliance|arc))", "drive"),
    (r"\barm\b(?! inertia)", "drive"),
)


def fitting(text: str, setting: Setting) -> str:
    """Return a sentence of the library in the words of the bench on which the trials were recorded."""
    rules = {"finger": (), "lever": _SPECIMEN, "other": (*_SPECIMEN, *_DRIVE)}[setting]
    for pattern, word in rules:
        text = re.sub(pattern, word, text)
        text = re.sub(pattern.capitalize(), word.capitalize(), text) if pattern.isalpha() else text
    return text


def in_words_of_its_bench(report: Report) -> Report:
    """Return the report, every sentence in the words of its setting."""

    def say(text: str) -> str:
        return fitting(text, report.setting)

    following = report.next_experiment
    return replace(
        report,
        summary=say(report.summary),
        mechanisms=tuple(replace(m, explanation=say(m.explanation)) for m in report.mechanisms),
        not_identifiable=tuple(replace(n, reason=say(n.reason)) for n in report.not_identifiable),
        notes=tuple(map(say, report.notes)),
        next_experiment=following and replace(following, reason=say(following.reason)),
    )
