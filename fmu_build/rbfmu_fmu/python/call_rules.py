"""The rules of FMI calls: the phases in which calls are allowed and variables may be set, and categories of messages.

They are defined only here. The C layer gets them as a generated header (native/headers.py). The pythonfmu slave imports
this file, and so do the tests' model and the test that compares the rules with the standard's table. It imports only
the standard library.
"""

from typing import NamedTuple

PHASES = {
    "INSTANTIATED": "before initialisation",
    "INITIALIZING": "in initialisation",
    "STEPPING": "while stepping",
    "TERMINATED": "after termination",
}
"""The phases of an instance's life by name, in their order, each with the words that a refusal ends with."""

INSTANTIATED, INITIALIZING, STEPPING, TERMINATED = range(len(PHASES))
PHASE_TEXTS = tuple(PHASES.values())


class Rule(NamedTuple):
    """The phases in which a call is allowed, and the message in all others, which the phase's words follow."""

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
"""The calls that are refused in some phase. All others are allowed in every phase: reading inputs, parameters and
`status`, saving and restoring states, resetting and freeing an instance."""

SETTABLE = {
    "input": (INSTANTIATED, INITIALIZING, STEPPING),
    "parameter": (INSTANTIATED, INITIALIZING),
    "output": (),
}
"""The phases in which variables may be set, by causality."""

SET_REFUSAL = "%s %s cannot be set %s"
"""The message if a variable may not be set in a phase, given its causality, its name, and the phase's words."""

LOG_CATEGORIES = {
    "logStatusWarning": "what may be less accurate than expected",
    "logStatusDiscard": "why a step was not taken; nothing has changed",
    "logStatusError": "why a call was refused; nothing has changed",
    "logStatusFatal": "why a call was refused after which no other is allowed",
    "logAll": "all messages",
}
"""The categories of messages, each with what its messages say."""


def refusal(call: str, phase: int) -> str:
    """Return the message for a call that is not allowed in a phase."""
    return f"{CALLS[call].refusal} {PHASE_TEXTS[phase]}"


def set_refusal(causality: str, name: str, phase: int) -> str:
    """Return the message for a variable that may not be set in a phase."""
    return SET_REFUSAL % (causality, name, PHASE_TEXTS[phase])
