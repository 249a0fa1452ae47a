"""The rules of calls are those of FMI 2.0.4 for co-simulation, but for the differences that are listed here."""

from rbfmu_fmu.python.call_rules import CALLS, INITIALIZING, INSTANTIATED, SETTABLE, STEPPING, TERMINATED

ALL = "instantiated", "initialization", "complete", "in progress", "failed", "canceled", "terminated", "error"
"""The standard's states of an instance: between instantiation and the end, of its step, and after it."""
NOT_IN_STEP = tuple(state for state in ALL if state != "in progress")
READABLE = tuple(state for state in NOT_IN_STEP if state != "instantiated")
STATUS = "complete", "in progress", "failed", "terminated"

STANDARD = {
    "SetDebugLogging": ALL,
    "FreeInstance": NOT_IN_STEP,
    "SetupExperiment": ("instantiated",),
    "EnterInitializationMode": ("instantiated",),
    "ExitInitializationMode": ("initialization",),
    "Terminate": ("complete", "failed"),
    "Reset": NOT_IN_STEP,
    "GetXXX of an output": READABLE,
    "GetXXX of an input": READABLE[1:],
    "GetXXX of a parameter": READABLE[1:],
    "SetXXX of an input": ("initialization", "complete"),
    "SetXXX of a parameter": ("instantiated", "initialization"),
    "SetXXX of an output": (),
    "GetFMUstate": NOT_IN_STEP,
    "SetFMUstate": NOT_IN_STEP,
    "FreeFMUstate": NOT_IN_STEP,
    "SerializedFMUstateSize": NOT_IN_STEP,
    "SerializeFMUstate": NOT_IN_STEP,
    "DeSerializeFMUstate": NOT_IN_STEP,
    "GetDirectionalDerivative": READABLE,
    "SetRealInputDerivatives": ("instantiated", "initialization", "complete"),
    "GetRealOutputDerivatives": READABLE[1:],
    "DoStep": ("complete",),
    "CancelStep": ("in progress",),
    "GetXXXStatus": STATUS,
}
"""Section 4.2.4, the table of allowed calls and its notes: for `fmi2` and a name, the states.

Parameters here are fixed, initial = exact; outputs are calculated; inputs have no `initial`.
"""

STATES = {
    INSTANTIATED: {"instantiated"}, INITIALIZING: {"initialization"}, STEPPING: {"complete", "failed"},
    TERMINATED: {"terminated"},
}  # fmt: skip
"""The standard's states that a phase stands for. No step is pending here, and no refused call leads to `error`."""
RULES = {name: rule.phases for name, rule in CALLS.items()} | {f"set_{c}": allowed for c, allowed in SETTABLE.items()}
OURS = {
    "SetupExperiment": "set_up_experiment",
    "EnterInitializationMode": "enter_initialization",
    "ExitInitializationMode": "exit_initialization",
    "Terminate": "terminate",
    "GetXXX of an output": "get_outputs",
    "SetXXX of an input": "set_input",
    "SetXXX of a parameter": "set_parameter",
    "SetXXX of an output": "set_output",
    "SetRealInputDerivatives": "set_input_derivatives",
    "GetRealOutputDerivatives": "get_outputs",
    "GetDirectionalDerivative": "get_outputs",
    "DoStep": "do_step",
}
"""The rule of a call; any other call is allowed in all phases, or never."""
NEVER = {"CancelStep"}

MORE = {
    "GetXXX of an input": {"instantiated", "initialization"},
    "GetXXX of a parameter": {"instantiated", "initialization"},
    "SetXXX of an input": {"instantiated", "failed"},
    "SetRealInputDerivatives": {"failed"},
    "GetRealOutputDerivatives": {"initialization"},
    "DoStep": {"failed"},
    "GetXXXStatus": {"instantiated", "initialization"},
}
"""What is allowed beyond the standard: an instance is usable after a discarded step, of which nothing happened."""


def phases(call):
    """Where ours is allowed."""
    return () if call in NEVER else RULES[OURS[call]] if call in OURS else tuple(STATES)


def test_calls_are_allowed_where_the_standard_allows_them():
    for call, allowed in STANDARD.items():
        ours = {state for phase in phases(call) for state in STATES[phase]}
        standard = set(allowed) & set.union(*STATES.values())
        assert ours - standard == MORE.get(call, set()), call
        assert standard <= ours, call


def test_every_rule_is_compared():
    assert set(OURS.values()) == set(RULES)
