"""The rules of FMI calls: which call an instance allows when, when a variable may be set, and categories of messages.

This is their only place. The C layer gets them as a generated header (native/headers.py), the pythonfmu slave has this
file beside it, and so do the tests' model and the test that compares them with the standard's table. It needs nothing.
"""

from typing import NamedTuple

PHASES = {
    "INSTANTIATED": "before initialisation",
    "INITIALIZING": "in initialisation",
    "STEPPING": "while stepping",
    "TERMINATED": "after termination",
}
"""By name, in the order of an instance's life: how a message says when a call was refused."""

INSTANTIATED, INITIALIZING, STEPPING, TERMINATED = range(len(PHASES))
PHASE_TEXTS = tuple(PHASES.values())


class Rule(NamedTuple):
    """The phases in which a call is allowed, and what is said of it in the others, before the phase's text."""

    phases: tuple[int, ...]
    refusal: str


CALLS = {
    "set_up_experiment": Rule((INSTANTIATED,), "the experiment cannot be set up"),
    "enter_initialization": Rule((INSTANTIATED,), "initialisation cannot begin"),
    "exit_initialization": Rule((INITIALIZING,), "initialisation cannot end"),
    "do_step": Rule((STEPPING,), "no step can be taken"),
    "terminate": Rule((STEPPING,), "there is nothing to terminate"),
    "get_outputs": Rule((INITIALIZING, STEPPING, TERMINATED), "outputs have no values"),
    "set_input_derivatives": Rule((INSTANTIATED, INITIALIZING, STEPPING), "derivatives of inputs cannot be set"),
}
"""Calls that some phase refuses. Every other one is allowed in all phases: inputs, parameters and `status` can always
be read, states saved and restored, and an instance reset and freed."""

SETTABLE = {
    "input": (INSTANTIATED, INITIALIZING, STEPPING),
    "parameter": (INSTANTIATED, INITIALIZING),
    "output": (),
}
"""By causality: the phases in which variables may be set."""

SET_REFUSAL = "%s %s cannot be set %s"
"""The message where a phase does not allow that: causality, name, the phase's text."""

LOG_CATEGORIES = {
    "logStatusWarning": "what may be less accurate than expected",
    "logStatusDiscard": "why a step was not taken; nothing has changed",
    "logStatusError": "why a call was refused; nothing has changed",
    "logStatusFatal": "why a call was refused after which no other is allowed",
    "logAll": "all messages",
}
"""By name, what a message of the category says."""


def refusal(call: str, phase: int) -> str:
    """Return the message where a phase does not allow a call."""
    return f"{CALLS[call].refusal} {PHASE_TEXTS[phase]}"


def set_refusal(causality: str, name: str, phase: int) -> str:
    """Return the message where a phase does not allow that a variable is set."""
    return SET_REFUSAL % (causality, name, PHASE_TEXTS[phase])
