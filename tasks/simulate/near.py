"""What runs of a specimen have shown, for other runs with nearly the same parameters."""

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np

from sinew.tasks.simulate import Array
from sinew.tasks.simulate.balance import Ask, Balance, balance, run_along
from sinew.tasks.simulate.linear_specimens import LinearSpecimens, Response, Run
from sinew.tasks.simulate.machines import Machines
from sinew.tasks.simulate.row_by_row import Failed

SMALL = 1e-3  # of a unit cube: over smaller steps, outputs show the solver's tolerance and no slope
FAR = 0.1  # of the largest displacement: what happens there says nothing of slopes here
PROBES, PROBE = 4, 3e-3  # runs for one direction of displacement, at most; their length, of the largest displacement
UNKNOWN = 1e-2  # of a step: what no run has shown of it may be so large
KEPT = 0.02  # of a unit cube: with parameters farther away, the answer to other displacements is another


@dataclass(frozen=True, eq=False)
class Known:
    """A ``run`` along one protocol with parameters ``values`` ``[d]`` (unit cube), without those of effects around it.

    ``response``: of its outputs, the force (N) first, to the displacement; ``slopes`` ``[d, 1 + k, t]``: by the
    parameters along the same displacement; ``followed``: whether they are known. ``rigid_N`` ``[1, t]``: the force if
    the machine did not give way, where asked, and its ``rigid_slopes`` ``[d, t]``.
    """

    values: Array
    run: Run
    response: Response
    slopes: Array
    rigid_N: Array | None
    rigid_slopes: Array
    followed: bool = False

    @classmethod
    def of(cls, values: Array, balance: Balance) -> "Known":
        """What a first balance shows."""
        slopes = np.zeros((values.size, *balance.courses.shape))
        return cls(values, balance.last, balance.response, slopes, balance.machine.rigid_N, np.zeros_like(slopes[:, 0]))

    def at(self, values: Array) -> LinearSpecimens:
        """Specimens with other ``values`` ``[n, d]`` of the parameters."""
        courses = self.run.courses + np.tensordot(values - self.values, self.slopes, 1)
        return LinearSpecimens(self.run, courses, self.response)

    def courses(self, values: Array, displacement: Array) -> Array | None:
        """The outputs ``[1 + k, t]`` of the run, if it is the one with these ``values`` ``[d]`` and displacement."""
        same = np.array_equal(values, self.values) and np.array_equal(displacement, self.run.displacement_mm)
        return self.run.courses if same else None

    def begin(self, machine: Machines, values: Array) -> Array:
        """The displacement ``[t]`` (mm) with which runs with ``values`` ``[d]`` in a ``machine`` may begin."""
        if np.array_equal(values, self.values):
            return self.run.displacement_mm
        return self._displacement(machine, values[np.newaxis])[0]

    def pulled(self, machines: Machines, values: Array) -> Array:
        """Outputs ``[n, 1 + k, t]`` with ``values`` ``[n, d]`` as ``machines`` read them, without a run."""
        displacement = self._displacement(machines, values)
        courses = self.at(values).along(displacement)
        courses[:, 0] = machines.read(displacement, courses[:, 0])
        return courses

    def then(self, values: Array, balance: Balance) -> "Known":
        """What is known where a balance with other ``values`` was run last."""
        moved = np.abs(balance.last.displacement_mm - self.run.displacement_mm).max()
        tells = np.linalg.norm(values - self.values) > SMALL and moved < FAR * balance.machine.largest_mm
        rigid = balance.machine.rigid_N
        known = self._following(values, balance.last, rigid) if tells else self
        return replace(known, values=values, run=balance.last, response=balance.response, rigid_N=rigid)

    def beside(self, machine: Machines, values: Array, there_in: Machines, ask: Ask, ask_there: Ask) -> "Known":
        """The same after the runs that tell what a ``machine`` reads where ``values`` ``[d]`` are a small step away.

        The step is from what is known, ``there_in`` another machine. ``ask`` runs the specimen with these ``values``,
        ``ask_there`` with those that are known. Raises :class:`Failed`.
        """
        known, there = self, self.run
        if not np.array_equal(values, self.values):
            run = run_along(ask, there.displacement_mm)
            rigid = run_along(ask, machine.at_grips()[0]).courses[:1] if machine.asks_rigid else None
            known = replace(self._following(values, run, rigid), followed=True)
        for _ in range(PROBES):
            step = known._displacement(machine, values[np.newaxis])
            step = step - known._displacement(there_in, self.values[np.newaxis])
            if np.linalg.norm(known.response.to(step)[1]) <= UNKNOWN * np.linalg.norm(step):
                break
            probe = step[0] * (PROBE * machine.largest_mm / float(np.abs(step).max()))
            changed = run_along(ask_there, there.displacement_mm + probe).courses - there.courses
            known = replace(known, response=known.response.after(probe, changed, machine.largest_mm))
        return known

    def afresh(self) -> "Known":
        """The same without what earlier runs have shown of the answer to other displacements."""
        return replace(self, response=replace(self.response, shown=self.response.shown.forgotten()))

    def _displacement(self, machines: Machines, values: Array) -> Array:
        """The displacements ``[n, t]`` (mm) of specimens with ``values`` ``[n, d]``."""
        if not machines.gives_way:
            return machines.at_rest()
        if machines.asks_rigid and self.rigid_N is not None:
            machines = machines.with_rigid(self.rigid_N + (values - self.values) @ self.rigid_slopes)
        return machines.in_balance(self.at(values))

    def _following(self, values: Array, run: Run, rigid: Array | None) -> "Known":
        """The same with slopes that explain a ``run`` with other ``values`` ``[d]``: the nearest (Broyden 1965).

        ``rigid``: its force ``[1, t]`` if the machine did not give way, where asked.
        """
        step = values - self.values
        weights = step / (step @ step)
        wrong = run.courses - self.at(values[np.newaxis]).along(run.displacement_mm[np.newaxis])[0]
        known = replace(self, slopes=self.slopes + np.multiply.outer(weights, wrong))
        if rigid is None or self.rigid_N is None:
            return known
        wrong = rigid[0] - self.rigid_N[0] - step @ self.rigid_slopes
        return replace(known, rigid_slopes=self.rigid_slopes + np.multiply.outer(weights, wrong))


@dataclass(frozen=True, eq=False)
class First:
    """The balance of a first row with parameters ``values`` ``[d]``."""

    values: Array
    balance: Balance


@dataclass(frozen=True, eq=False)
class Near:
    """What is ``known`` of one specimen by the digest of the protocol, from which runs start; they leave more.

    Of all rows that are asked of a simulator with this object, the first of each protocol is the one that is known from
    then on; the others are small steps from it, and follow linearly.
    """

    known: dict[str, Known]
    first: dict[str, First] = field(default_factory=dict)
    afresh: set[str] = field(default_factory=set)

    def row(self, key: str, machine: Machines, at: Array, values: Array, along: Callable[[Array], Ask]) -> Array:
        """Outputs ``[1 + k, t]`` of the specimen with ``values`` ``[d]``, ``at`` on the unit cube, in a ``machine``.

        ``along``: of such values, what runs the specimen. Raises :class:`Failed`.
        """
        known = self.known.get(key)
        if known is not None and key in self.first:
            courses = self._beside(key, machine, at, values, along)
            if not np.isfinite(courses).all():
                raise Failed("diverged", "with its effects, an output is not a number")
            return courses

        def ask(displacement: Array) -> Array:
            there = None if known is None else known.courses(at, displacement)
            return along(values)(displacement) if there is None else there

        start = None
        if known is not None and machine.gives_way:
            near = np.linalg.norm(at - known.values) <= KEPT
            start = known.begin(machine, at), known.response if near else known.afresh().response
        found = balance(machine, ask, start, linear=True)
        self.known[key] = Known.of(at, found) if known is None else known.then(at, found)
        self.first[key] = First(values, found)
        return found.courses

    def _beside(self, key: str, machine: Machines, at: Array, values: Array, along: Callable[[Array], Ask]) -> Array:
        """As :meth:`row`, of a small step from the first row."""
        if key not in self.afresh:  # what was seen of other parameters would mislead the differences
            self.known[key] = self.known[key].afresh()
            self.afresh.add(key)
        first, known = self.first[key], self.known[key]
        known = known.beside(machine, at, first.balance.machine, along(values), along(first.values))
        self.known[key] = known
        # differences of what is linear alike: the first row was balanced with what was known before
        change = known.pulled(machine, at[np.newaxis]) - known.pulled(first.balance.machine, known.values[np.newaxis])
        return np.asarray(first.balance.courses + change[0])
