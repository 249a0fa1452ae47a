"""The stateful test for FMI 3.0, of FMUs without arrays: the same rules where both versions have a call."""

from tests.support.fmu.conformance.child import Renamed
from tests.support.fmu.conformance.machine import NO_INSTANCE, CallMachine
from tests.support.fmu.conformance.model import Model
from tests.support.fmu.fmu_importer import OK


class Names:
    """Gives back the name that is asked for."""

    def __getattr__(self, name):
        return name


class Model3(Model):
    """An experiment is set up when initialisation begins, with the times that the importer said last."""

    def __init__(self, facts):
        self.times = 0.0, None
        super().__init__(facts)

    def setup(self, start, stop):
        self.times = start, stop
        return OK, None

    def enter(self):
        if not self._allowed("enter_initialization") or super().setup(*self.times)[0] != OK:
            return self.refused
        return super().enter()

    def get_real(self, references):
        """The time is the variable after the Reals."""
        time = self.facts.reals
        status, values = super().get_real([r for r in references if r != time])
        if status != OK:
            return self.refused
        left = iter(values)
        return OK, [self.now.time if r == time else next(left) for r in references]


class CallMachine3(CallMachine):
    """There are no derivatives of inputs, and no inquiries: the time is a variable."""

    model = Model3
    inquiries = ()
    no_instance = tuple(row for row in NO_INSTANCE if row[1] not in ("status", "setup"))

    def named(self, function):
        name, *rest = function.split(" ")
        return " ".join([getattr(Renamed(Names()), name), *rest])

    def set_rates(self, number, model, which, of, values):
        pass

    def compare(self, number, model):
        super().compare(number, model)
        time = [model.facts.reals]
        self.check("fmi2GetReal", (OK, [model.now.time]), "values", number, "fmi2GetReal", time, None, 0)
