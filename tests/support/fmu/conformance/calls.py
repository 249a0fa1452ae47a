"""Calls of an FMU in a child process, each compared with what the model answers."""

import math
from collections import Counter

from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine

from tests.support.fmu.fmu_importer import DISCARD, ERROR, OK, WARNING

INQUIRIES = [("Real", 2), ("Boolean", 3), ("Status", 0), ("Integer", 0), ("String", 1), ("Real", 3), ("Boolean", 5)]
"""Of fmi2GetXStatus: kind of value, and what is asked for. The first two have an answer."""
some = st.integers(0, 1000)
"""Picks one of those that are there."""


def same(a, b):
    """Equal to the bit, but for a NaN's; lists and single values."""
    if isinstance(a, list) and isinstance(b, list):
        return len(a) == len(b) and all(map(same, a, b))
    if isinstance(a, float) and isinstance(b, float):
        return (a == b and math.copysign(1.0, a) == math.copysign(1.0, b)) or (a != a and b != b)
    return a == b


def some_live(machine):
    """A precondition of rules: there is an instance."""
    return bool(machine.live)


class ComparedCalls(RuleBasedStateMachine):
    """Instances, states and serialised bytes are lists; a rule picks from them by number."""

    inquiries = INQUIRIES

    def named(self, function):
        """The name of a function in the version of FMI in use."""
        return function

    def __init__(self, kind, process, facts):
        super().__init__()
        self.kind, self.native, self.process, self.facts = kind, kind != "python", process, facts
        self.live, self.places, self.addresses, self.blobs = {}, {}, {}, []
        self.made = 0

    # --- the bridge

    def ask(self, function, expected, operation, *arguments, errors=None):
        """Make a call and compare its answer; returns (status, result). errors: how many must be logged.

        expected: what the model says, or how to ask it: after the child, which alone may hang.
        """
        status, result, log = self.process.ask(operation, *arguments)
        self.expected = expected = expected() if callable(expected) else expected
        function = self.named(function)
        self.process.calls[function] += 1
        self.process.refused[function] += status != OK or result is False
        self.must(status == expected[0], function, arguments, status, expected, log)
        if self.native:  # one message for each refused call, none else; discards where they are wanted
            told = Counter(severity for severity, category, text in log if category and text)
            self.must(told[ERROR] == (status == ERROR if errors is None else errors), function, log)
            self.must(told[DISCARD] <= (status == DISCARD), function, log)
            self.must(told[WARNING] <= ("tolerance" in log[0][2].decode() if log else 0), function, log)
            self.must(len(log) == told[ERROR] + told[DISCARD] + told[WARNING], function, log)
        return status, result

    def must(self, fine, *what):
        """Else this example fails; the next one begins in a new process."""
        if not fine:
            self.process.end()
            raise AssertionError(repr(what)[:2000])

    def check(self, function, expected, operation, *arguments, errors=None, result=True):
        """The same, and the result must be the expected one."""
        _, found = self.ask(function, expected, operation, *arguments, errors=errors)
        self.must(not result or same(found, self.expected[1]), function, arguments, found, self.expected)

    def one(self, pick):
        """(number, model) of an instance."""
        number = sorted(self.live)[pick % len(self.live)]
        return number, self.live[number]

    def right(self, which, model):
        """Value references, of those that count from the end."""
        return [r if r >= 0 else model.facts.reals + 2 + r for r in which]

    # --- reading

    def get_reals(self, number, model, which, null=0):
        self.check("fmi2GetReal", model.get_real(which), "values", number, "fmi2GetReal", which, None, null)

    def compare(self, number, model):
        """All that can be read."""
        self.get_reals(number, model, model.facts.outputs)
        self.get_reals(number, model, model.facts.inputs + model.facts.parameters)
        which, function = [model.facts.status], "fmi2GetInteger"
        self.check(function, model.get_integer(which), "values", number, function, which, None, 0)
        for kind, wanted in self.inquiries[:2]:
            function = f"fmi2Get{kind}Status"
            self.check(function, model.inquiry(kind, wanted), "status", number, function, wanted)
