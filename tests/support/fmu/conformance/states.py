"""Rules for saved states: places hold an address, or none; `addresses` says what is there."""

from hypothesis import strategies as st
from hypothesis.stateful import precondition, rule

from tests.support.fmu.conformance.calls import ComparedCalls, some, some_live
from tests.support.fmu.fmu_importer import OK


class SavedStates(ComparedCalls):
    """Instances whose states are saved, restored, freed, and turned into bytes and back."""

    def known_at(self, model, place):
        """The snapshot that this instance may use at the address in a place, or None."""
        found = self.addresses.get(self.places.get(place))
        if found is None:
            return None
        owner, facts, snapshot = found
        return snapshot if facts is model.facts and (not self.native or owner is model) else None

    def usable(self, place):
        """Pythonfmu follows any pointer: not null, not freed."""
        return self.native or self.places.get(place) in self.addresses

    @precondition(some_live)
    @rule(pick=some, place=st.integers(0, 1))
    def get_state(self, pick, place):
        number, model = self.one(pick)
        before = self.places.get(place)
        expected = (OK, None) if not self.native or before is None or self.known_at(model, place) else model.refused
        status, address = self.ask("fmi2GetFMUstate", expected, "get_state", number, place)
        if status == OK:
            self.put(place, address, model, model.now)
        else:
            self.must(address == before, "fmi2GetFMUstate", address, before)

    def put(self, place, address, model, snapshot):
        self.must(address, "no state")
        self.places[place] = address
        self.addresses[address] = (model, model.facts, snapshot.copy())

    @precondition(some_live)
    @rule(pick=some, place=st.integers(0, 1))
    def set_state(self, pick, place):
        number, model = self.one(pick)
        if self.usable(place):
            snapshot = self.known_at(model, place)
            expected = model.restore(snapshot) if snapshot else model.refused
            self.check("fmi2SetFMUstate", expected, "set_state", number, place)
            self.compare(number, model)

    @precondition(some_live)
    @rule(pick=some, place=st.integers(0, 1), keep=st.booleans())
    def free_state(self, pick, place, keep):
        number, model = self.one(pick)
        address = self.places.get(place)
        if address is None:
            self.check("fmi2FreeFMUstate", (OK, None), "free_state", number, place, False)
        elif self.native:
            known = self.known_at(model, place) is not None
            expected = (OK, None) if known else (model.refused[0], address)
            self.check("fmi2FreeFMUstate", expected, "free_state", number, place, keep)
            if known:
                del self.addresses[address]
                self.places[place] = address if keep else None
        elif address in self.addresses:
            self.ask("fmi2FreeFMUstate", (OK, None), "free_state", number, place, False)
            del self.addresses[address]
            self.places[place] = None

    @precondition(some_live)
    @rule(pick=some, place=st.integers(0, 1), fill=st.booleans(), room=st.sampled_from([0, 0, 0, -1, -7, 1]))
    def serialize(self, pick, place, fill, room):
        number, model = self.one(pick)
        if fill:
            self.get_state(pick, place)
        if not self.usable(place):
            return
        known = self.known_at(model, place) if self.native else self.addresses[self.places[place]][2]
        expected = (OK, None) if known else model.refused
        _, size = self.ask("fmi2SerializedFMUstateSize", expected, "size", number, place)
        if not self.native:
            room = min(room, 0)  # it reads as many bytes as it is told to write
        expected = model.refused if self.native and (not known or room < 0) else (OK, None)
        _, content = self.ask("fmi2SerializeFMUstate", expected, "serialize", number, place, max(size + room, 0))
        if expected[0] == OK and room == 0:
            self.blobs = [*self.blobs[-9:], (content, self.addresses[self.places[place]][1], known.copy())]

    @precondition(some_live)  # not of blobs: whether there are any hangs on the addresses that the child's memory gives
    @rule(pick=some, which=some, place=st.integers(0, 1), damage=st.none() | st.tuples(some, st.integers(1, 255)),
          size=st.sampled_from([0, 0, 0, 0, -1, 1, -10**6]))  # fmt: skip
    def deserialize(self, pick, which, place, damage, size):
        if not self.blobs:
            return
        number, model = self.one(pick)
        content, facts, snapshot = self.blobs[which % len(self.blobs)]
        given = bytearray(content)
        if damage:
            given[damage[0] * len(content) // 1001] ^= damage[1]
        given = bytes(given[: max(len(given) + size, 0)] + b"\0" * max(size, 0))
        fine = given == content and facts is model.facts
        before, function = self.places.get(place), "fmi2DeSerializeFMUstate"
        expected = (OK, None) if fine else model.refused
        status, address = self.ask(function, expected, "deserialize", number, place, given)
        if status == OK:
            self.put(place, address, model, snapshot)
        else:
            self.must(address == before, function, address, before)
