"""Modes of a linear system: frequency, damping, participation, shape and label; tracked along a sweep."""

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from dualwinch.model.arguments import instance
from dualwinch.model.heavy_ropes import end_mass, lumped_mass, rope_on_drum, transverse_mass
from dualwinch.model.linear.operating_point import PRELOAD
from dualwinch.model.linear.properties import eigenvalue_errors
from dualwinch.model.linear.system import LinearSystem
from dualwinch.model.plant import Plant, PlantState, Side, blank_state
from dualwinch.model.quantities.description import Leaf, describe, describe_parts
from dualwinch.model.quantities.quantity import Mark
from dualwinch.model.ropes import rope_lengths
from dualwinch.model.scalar import present
from dualwinch.model.vehicle import inertia
from dualwinch.model.winch import total_inertia

RIGID = 0.05
"""A mode is rigid where the ropes stretch by less than this share of the largest displacement."""

TAKES_PART = 0.2
"""Least share of the kinetic (elastic) energy with which a body (a rope) takes part in a mode."""


class SideMotion(NamedTuple):
    """A mode of a winch and its rope: complex displacements in m, along the track except for the sag.

    Attributes:
        drum: rim of the drum.
        nodes: nodes of the rope, from the drum to the vehicle.
        sag: sag of the rope, 0 without any.
        rotor: rotor, at the drum's rim; None where the gearbox is rigid.
    """

    drum: complex
    nodes: tuple[complex, ...]
    sag: complex
    rotor: complex | None

    def largest(self, kind: str) -> complex:
        """The largest displacement of a kind of mode (`MODE_KINDS`)."""
        displacements_by_kind = {"waves": self.nodes, "gear": (self.rotor or 0j,), "sag": (self.sag,)}
        return max(displacements_by_kind[kind], key=abs, default=0j)


class Shape(NamedTuple):
    """A mode of the plant in metres: complex displacements of the vehicle, and of winch 1 and winch 2."""

    vehicle: complex
    sides: tuple[SideMotion, SideMotion]

    @property
    def stretches(self) -> tuple[complex, complex]:
        """Stretches of rope 1 and rope 2."""
        return self.sides[0].drum - self.vehicle, self.vehicle - self.sides[1].drum

    @property
    def largest(self) -> complex:
        """The largest displacement."""
        displacements = [self.vehicle, *(side.drum for side in self.sides)]
        return max(*displacements, *(side.largest(kind) for side in self.sides for kind in MODE_KINDS), key=abs)

    @property
    def is_rigid(self) -> bool:
        """Whether all displacements are equal, within `RIGID`."""
        deformations = list(self.stretches)
        for side in self.sides:
            deformations += [side.sag, *(node - self.vehicle for node in side.nodes)]
            deformations += [] if side.rotor is None else [side.rotor - side.drum]
        return max(map(abs, deformations)) < RIGID * abs(self.largest)


def label(system: LinearSystem, participation: Mapping[str, float], shape: Mapping[str, complex], plant: Plant) -> str:
    """Label of a mode in words, from each state's participation factor and complex amplitude.

    The mode is named after the largest share of its kinetic energy: drums and vehicle, waves in a rope, a gearbox whose
    rotor swings against its drum, or the sag; a friction state after its place. Longitudinal modes of a rope are
    counted from the one in which the whole rope moves in one direction, at c/4L for a drum without inertia; with a
    heavy drum that is the drum's mode, and the second is near c/2L.

    The shares of the two sides are the participation factors of the states of that winch and rope. Without damping
    these are the shares of energy; in a closed loop a mode of one gearbox may move the other one further.
    """
    prefix = plant_prefix(system.states)
    x = system.operating_point.get("x")
    if prefix is None or x is None:
        return _by_states(participation)
    descriptions = describe_parts(blank_state(plant))
    shares = {key: participation.get(prefix + key, 0.0) for key in descriptions}
    if sum(shares.values()) < 0.5:
        return _by_states(participation)
    main = max(shares, key=lambda key: shares[key])
    if Mark.SETTLES in descriptions[main].marks:
        return "friction on the rail" if main.startswith("rail") else f"friction within rope {main[5]}"
    displaced = displacements(shape, plant, prefix)
    if displaced.is_rigid:
        speed, position = participation[prefix + "v"], participation[prefix + "x"]
        return "rigid drift: speed" if speed > position else "rigid drift: position"
    lengths = rope_lengths(x, plant.track)
    weights = [_side_masses(side, length, plant) for side, length in zip(plant.sides, lengths, strict=True)]
    energies = [mass.energies(motion, displaced.vehicle) for mass, motion in zip(weights, displaced.sides, strict=True)]
    factors = _side_factors([sum(energy.values()) for energy in energies], shares, descriptions)
    energies = [
        {kind: factor * of for kind, of in energy.items()} for factor, energy in zip(factors, energies, strict=True)
    ]
    vehicle = inertia(plant.vehicle) * abs(displaced.vehicle) ** 2
    totals = {kind: sum(energy[kind] for energy in energies) for kind in energies[0]}
    kind = max(totals, key=lambda each: totals[each] + (vehicle if each == "drum" else 0.0))
    if kind != "drum":
        return _by_kind(kind, [energy[kind] for energy in energies], displaced)
    tension = system.operating_point.get
    sides = zip(plant.sides, lengths, ("F1", "F2"), strict=True)
    springs = [side.rope.tangent(tension(name, PRELOAD / 2), length)[0] for side, length, name in sides]
    masses = [factor * (mass.drum + mass.rotor) for factor, mass in zip(factors, weights, strict=True)]
    springs = [factor * spring for factor, spring in zip(factors, springs, strict=True)]
    return _by_energies(displaced, (inertia(plant.vehicle), *masses), springs)


def _side_factors(
    energies: Sequence[float], shares: Mapping[str, float], known: Mapping[str, Leaf]
) -> tuple[float, float]:
    """Factors on the energies of both sides that make them proportional to the participation of the sides' states.

    They keep the sum of the energies; friction states do not count.
    """
    moving = {key: share for key, share in shares.items() if Mark.SETTLES not in known[key].marks}
    sides = ((f"theta_{side}", f"omega_{side}", f"rope_{side}.", f"motor_{side}.") for side in (1, 2))
    share_1, share_2 = (sum(share for key, share in moving.items() if key.startswith(begins)) for begins in sides)
    if not all(energies) or not share_1 + share_2:
        return 1.0, 1.0
    energy = sum(energies) / (share_1 + share_2)
    return energy * share_1 / energies[0], energy * share_2 / energies[1]


class SideMasses(NamedTuple):
    """Masses in kg of a winch and its rope, referred to motion along the track or, for the sag, at midspan."""

    drum: float
    rotor: float
    end: float
    node: float
    sag: float

    def energies(self, motion: SideMotion, vehicle: complex) -> dict[str, float]:
        """Kind of a mode → twice its kinetic energy over the square of its angular frequency.

        The energy of rotor and drum is divided into that of their centre of mass ("drum") and of the relative motion
        ("gear").
        """
        drum, ends = motion.drum, abs(motion.drum) ** 2 + abs(vehicle) ** 2
        moving = {
            "drum": self.drum * abs(drum) ** 2,
            "waves": self.node * sum(abs(node) ** 2 for node in motion.nodes) + self.end * ends,
            "gear": 0.0,
            "sag": self.sag * abs(motion.sag) ** 2,
        }
        if motion.rotor is None:
            return moving
        both = self.drum + self.rotor
        together = (self.drum * drum + self.rotor * motion.rotor) / both
        swing = self.drum * self.rotor / both * abs(motion.rotor - drum) ** 2
        return moving | {"drum": both * abs(together) ** 2, "gear": swing}


def _side_masses(side: Side, length: float, plant: Plant) -> SideMasses:
    rope, winch, square = side.rope, side.winch, side.winch.drum_radius**2
    gives, end = present(winch.gear_stiffness), end_mass(rope, length)
    rotor = winch.gear_ratio**2 * winch.rotor_inertia / square if gives else 0.0
    drum = winch.inertia if gives else total_inertia(winch)
    return SideMasses(
        drum=drum / square + rope_on_drum(rope, length, plant.track) - end,
        rotor=rotor,
        end=end,
        node=lumped_mass(rope, length) if present(rope.mass_per_length) else 0.0,
        sag=8 / 15 * transverse_mass(rope) * length,
    )


MODE_KINDS = {
    "waves": ("rope {}, longitudinal mode {}", "ropes {}, longitudinal mode {}"),
    "gear": ("gearbox {}", "both gearboxes {}"),
    "sag": ("sag of rope {}", "sag of both ropes {}"),
}
"""Kind of a mode inside ropes and gearboxes → its label for one side and for both."""


def _by_kind(kind: str, energies: Sequence[float], moved: Shape) -> str:
    """Label of a mode from its kind and its energies on both sides."""
    one, two = MODE_KINDS[kind]
    stronger = int(energies[1] > energies[0])
    side = moved.sides[stronger]
    number = 1 + _sign_changes([moved.vehicle, *reversed(side.nodes), side.drum])
    if min(energies) < TAKES_PART * sum(energies):
        return one.format(stronger + 1, number)
    motion_1, motion_2 = (side.largest(kind) for side in moved.sides)
    return two.format("together" if (motion_1 * motion_2.conjugate()).real > 0 else "opposed", number)


def _sign_changes(along: Sequence[complex]) -> int:
    """Number of nodes of a mode's shape, from the displacements between vehicle and drum; small ones are ignored.

    The drum always counts: a heavy one hardly moves, but in the opposite direction to the rope next to it.
    """
    largest = max(along, key=abs)
    relative = [(way / largest).real for way in along[:-1] if abs(way) > RIGID * abs(largest)]
    relative.append((along[-1] / largest).real)
    return sum(before * after < 0 for before, after in pairwise(relative))


def plant_prefix(states: Sequence[str]) -> str | None:
    """Prefix of the names of the plant's six states; None where one is missing."""
    for name in states:
        prefix = name.removesuffix("theta_1")
        if prefix != name and all(prefix + state in states for state in describe(PlantState)):
            return prefix
    return None


def displacements(shape: Mapping[str, complex], plant: Plant, prefix: str = "") -> Shape:
    """A mode's displacements of the vehicle and of both winches with their ropes, in metres."""

    def motion(side: Side) -> SideMotion:
        rope, rotor = f"{prefix}rope_{side.number}.", f"{prefix}motor_{side.number}.theta"
        turn = side.direction * side.winch.drum_radius
        return SideMotion(
            drum=turn * shape[f"{prefix}theta_{side.number}"],
            nodes=tuple(
                side.direction * way for name, way in shape.items() if name.startswith(f"{rope}waves.position")
            ),
            sag=shape.get(f"{rope}sag.depth", 0j),
            rotor=turn * shape[rotor] if rotor in shape else None,
        )

    side_1, side_2 = plant.sides
    return Shape(shape[f"{prefix}x"], (motion(side_1), motion(side_2)))


def _by_energies(moved: Shape, masses: Sequence[float], springs: Sequence[float]) -> str:
    """Label of a mode from the energies of bodies (masses in kg) and ropes (spring rates in N/m)."""
    rims = [side.drum for side in moved.sides]
    vehicle, *drums = _taking_part(masses, [moved.vehicle, *rims])
    ropes = [number for number, takes_part in enumerate(_taking_part(springs, moved.stretches), start=1) if takes_part]
    turning = [number for number, takes_part in enumerate(drums, start=1) if takes_part]
    rope = "both ropes" if len(ropes) == 2 else f"rope {ropes[0]}"
    drum = "both drums" if len(turning) == 2 else f"drum {turning[0]}" if turning else ""
    if len(turning) == 2 and not vehicle:
        together = (rims[0] * rims[1].conjugate()).real > 0
        return "both drums " + ("together" if together else "opposed")
    if not vehicle:
        return f"{rope} – {drum}"
    return f"vehicle on {rope}" + (f", with {drum}" if drum else "")


def _taking_part(weights: Sequence[float], amplitudes: Sequence[complex]) -> list[bool]:
    energies = [weight * abs(amplitude) ** 2 for weight, amplitude in zip(weights, amplitudes, strict=True)]
    return [energy >= TAKES_PART * sum(energies) for energy in energies]


def _by_states(participation: Mapping[str, float]) -> str:
    main, *minor = sorted(participation.items(), key=lambda item: -item[1])
    names = [main[0], *(name for name, share in minor[:2] if share > main[1] / 3)]
    return ", ".join(names)


Complex = NDArray[np.complex128]

ZERO_EIGENVALUE = 1e-8
"""Eigenvalues below this share of the largest are zero up to round-off (the square root of it for a double one)."""

ROUND_OFF, DISTINCT = 1e-9, 1e6
"""Smallest share in a balanced vector that is none of round-off, and condition number below which vectors differ."""

SAMPLES_A_PERIOD = 10
"""Samples per period that control of a mode requires (Åström and Wittenmark: 10 to 30)."""

DEADBEAT = 1e-3
"""Magnitude of a discrete eigenvalue below which a mode vanishes within a sample and has no frequency."""


@dataclass(frozen=True)
class Mode:
    """One mode; an oscillation represents both of its conjugate eigenvalues.

    Attributes:
        eigenvalue: eigenvalue of A in 1/s, or per sample for a discrete system.
        rate: the same in 1/s; for a discrete system ``log(eigenvalue) / dt`` (minus infinity below `DEADBEAT`).
        error: bound on the rounding error of the rate in 1/s.
        participation: state → participation factor; these sum to one and do not depend on units.
        shape: state → complex amplitude, in the states' units.
        label: in words, e.g. "rope 2 – drum 2".
    """

    eigenvalue: complex
    rate: complex
    error: float
    participation: Mapping[str, float]
    shape: Mapping[str, complex]
    label: str

    @property
    def grows(self) -> bool:
        """Whether the mode is unstable: its growth is more than a rounding error."""
        return self.rate.real > self.error

    @property
    def natural_frequency(self) -> float:
        """Natural frequency in rad/s."""
        return abs(self.rate)

    @property
    def damping(self) -> float:
        """Damping ratio: 1 for a decay without oscillation, 0 for an integrator, negative for an unstable mode."""
        if math.isinf(self.natural_frequency):
            return 1.0
        return -self.rate.real / self.natural_frequency if self.rate else 0.0

    @property
    def time_constant(self) -> float:
        """Time in s in which the mode decays to 1/e; infinite for an integrator, negative for an unstable mode."""
        return -1 / self.rate.real if self.rate.real else math.inf

    @property
    def sample_rate(self) -> float:
        """Sample rate in Hz with `SAMPLES_A_PERIOD` samples per period of the natural frequency."""
        return SAMPLES_A_PERIOD * self.natural_frequency / (2 * math.pi)

    @property
    def main_states(self) -> tuple[str, ...]:
        """The states with the largest participation, in descending order, up to a sum of 90 %."""
        total, names = 0.0, []
        for name, share in sorted(self.participation.items(), key=lambda item: -item[1]):
            names.append(name)
            total += share
            if total >= 0.9:
                break
        return tuple(names)


def numbered(labels: Sequence[str]) -> list[str]:
    """Labels of modes with a number behind each that occurs more than once, in their order."""
    count = Counter(labels)
    return [
        f"{each} ({labels[: place + 1].count(each)})" if count[each] > 1 else each for place, each in enumerate(labels)
    ]


@dataclass(frozen=True, eq=False)
class Spectrum:
    """All eigenvalues of a system (n), with eigenvectors and bounds on their rounding errors (n).

    Right eigenvectors are columns, left ones rows of the inverse.
    A chain of integrators has only one eigenvector; a basis of its invariant subspace replaces it.
    """

    eigenvalues: Complex
    right: Complex
    left: Complex
    errors: NDArray[np.float64]


def modes(system: LinearSystem, plant: Plant | None = None) -> tuple[Mode, ...]:
    """Modes of a linear system, the slowest first.

    Args:
        system: any linear system; if its states include the plant's six, modes are labelled by their shape.
        plant: the plant that was linearised, for the labels (default: the paper's).

    Example:
        >>> import dualwinch as dw
        >>> for mode in dw.modes(dw.linearise(dw.case(4), x=25)):
        ...     print(f"{mode.label}: {mode.natural_frequency / (2 * 3.141593):.3g} Hz, damping {mode.damping:.2g}")
        rigid drift: position: 0 Hz, damping 0
        rigid drift: speed: 0.779 Hz, damping 1
        both drums opposed: 113 Hz, damping 0.25
        both drums together: 113 Hz, damping 0.25
    """
    instance("system", system, LinearSystem, hint=" (linearise makes one)")
    spectrum = spectra([system], plant or Plant())[0]
    system_modes = [
        mode(system, spectrum, k, plant or Plant())
        for k, eigenvalue in enumerate(spectrum.eigenvalues)
        if eigenvalue.imag >= 0
    ]
    return tuple(sorted(system_modes, key=lambda entry: entry.natural_frequency))


def mode(system: LinearSystem, spectrum: Spectrum, k: int, plant: Plant) -> Mode:
    """The mode of the k-th eigenvalue of a spectrum."""
    eigenvalue = complex(spectrum.eigenvalues[k])
    shares = np.abs(spectrum.left[k] * spectrum.right[:, k])
    participation = dict(zip(system.states, (shares / shares.sum()).tolist(), strict=True))
    shape = dict(zip(system.states, spectrum.right[:, k].tolist(), strict=True))
    rate, error = _rate(eigenvalue, system.dt), float(spectrum.errors[k])
    if system.dt is not None:
        error /= max(abs(eigenvalue), DEADBEAT) * system.dt
    return Mode(eigenvalue, rate, error, participation, shape, label(system, participation, shape, plant))


def spectra(systems: Sequence[LinearSystem], plant: Plant) -> list[Spectrum]:
    """Eigenvalues and eigenvectors of systems of one size, all at once; those of rigid motion are exactly zero."""
    matrices = np.array([system.A for system in systems])
    steady = np.array([0.0 if system.dt is None else 1.0 for system in systems])[:, None]
    eigenvalues, right = np.linalg.eig(matrices)
    still = np.abs(eigenvalues - steady) < ZERO_EIGENVALUE * np.abs(eigenvalues).max(axis=1, keepdims=True)
    eigenvalues = np.where(still, steady, eigenvalues)
    vectors = right.astype(np.complex128)
    for k in np.flatnonzero(still.sum(axis=1) > 1):
        memory = _memory(systems[int(k)].states, plant)
        vectors[k][:, still[k]] = _basis_of_still(
            matrices[k] - steady[k] * np.eye(len(matrices[k])), still[k].sum(), memory
        )
    left_vectors = np.linalg.pinv(vectors, rcond=1e-300)
    errors = eigenvalue_errors(matrices, vectors, left_vectors.astype(np.complex128))
    return [
        Spectrum(*entry) for entry in zip(eigenvalues.astype(np.complex128), vectors, left_vectors, errors, strict=True)
    ]


def _basis_of_still(A: NDArray[np.float64], count: int, memory: tuple[int, list[int]] | None) -> Complex:
    """Basis of the subspace of zero eigenvalues: a chain of integrators has fewer eigenvectors than eigenvalues.

    `A` is the matrix of a continuous system, or that of a discrete one less the identity, and has `count` such
    eigenvalues.
    """
    from scipy.linalg import matrix_balance, schur

    balanced, (scale, _) = matrix_balance(A, permute=False, separate=True)
    sizes = np.sort(np.abs(np.linalg.eigvals(balanced)))
    moving = sizes[count] if count < len(sizes) else np.inf
    between = np.sqrt(moving * max(sizes[count - 1], ZERO_EIGENVALUE * sizes[-1]))
    ordered: Any = schur(balanced, output="complex", sort=lambda rate: abs(rate) <= between)
    basis = ordered[1][:, :count]
    drift_basis = None if memory is None else _drift_apart(basis, *memory)
    basis = scale[:, None] * (basis if drift_basis is None else drift_basis)
    basis /= np.linalg.norm(basis, axis=0)
    if drift_basis is not None:
        return basis
    # later vectors of a chain may include multiples of the first: then they show the displacement of the drift
    basis[:, 1:] += basis[:, :1]
    return basis


def _memory(states: Sequence[str], plant: Plant) -> tuple[int, list[int]] | None:
    """Indices of the position and of the friction states (`Mark.SETTLES`) among the states; None without any."""
    prefix, index = plant_prefix(states), {name: place for place, name in enumerate(states)}
    if prefix is None:
        return None
    descriptions = describe_parts(blank_state(plant))
    friction = [
        index[prefix + key]
        for key, leaf in descriptions.items()
        if Mark.SETTLES in leaf.marks and prefix + key in index
    ]
    return (index[prefix + "x"], friction) if friction else None


def _drift_apart(basis: Complex, position: int, friction: Sequence[int]) -> Complex | None:
    """A basis of the same subspace whose first vector is the drift of the position, where friction remembers.

    At rest, every friction state adds a zero eigenvalue, as the deflection that it keeps is arbitrary; an eigensolver
    returns any mixtures of deflections and drift. The vectors returned have a unit in one of the position and as many
    friction states as there are further vectors, chosen by QR with column pivoting, and zeros in the others of these.

    The given basis (n, k) is that of the balanced matrix, and orthonormal. None where these states, given by their
    indices, do not determine one.
    """
    from scipy.linalg import qr

    dimension = basis.shape[1] - 1
    if dimension > len(friction):
        return None
    factors: Any = qr(basis[friction].T, mode="r", pivoting=True)
    friction_states = sorted(friction[column] for column in factors[1][:dimension])
    pivots = basis[[position, *friction_states]]
    sizes = np.abs(pivots).max(axis=1, keepdims=True)
    if sizes.min() < ROUND_OFF or np.linalg.cond(pivots / sizes) > DISTINCT:
        return None
    return basis @ np.linalg.inv(pivots)


def _rate(eigenvalue: complex, dt: float | None) -> complex:
    if dt is None:
        return eigenvalue
    return complex(np.log(eigenvalue)) / dt if abs(eigenvalue) > DEADBEAT else complex(-math.inf, 0.0)


CLEAR = 0.8
"""Overlap above which two successive modes are certainly the same."""


@dataclass(frozen=True)
class ModeTrack:
    """One mode along a sweep, with its most frequent label, numbered where several have it."""

    label: str
    modes: tuple[Mode, ...]

    @property
    def natural_frequencies(self) -> NDArray[np.float64]:
        """Natural frequency in rad/s at every point."""
        return np.array([entry.natural_frequency for entry in self.modes])

    @property
    def dampings(self) -> NDArray[np.float64]:
        """Damping ratio at every point."""
        return np.array([entry.damping for entry in self.modes])

    @property
    def rates(self) -> NDArray[np.complex128]:
        """Continuous-time eigenvalue in 1/s at every point."""
        return np.array([entry.rate for entry in self.modes])


def track_modes(systems: Sequence[LinearSystem], plant: Plant | None = None) -> tuple[ModeTrack, ...]:
    """Track the modes along systems that change little from one to the next, with the same states.

    Modes are matched by linear assignment: the left eigenvector of each with the right one of the other (a measure
    independent of the scaling of states), and the distance of their eigenvalues. Where modes mix, as those of two equal
    ropes in the middle of the track, they are matched with the last distinct ones. Labels are for the plant that was
    linearised (default: the paper's).

    Returns:
        The tracks, in ascending natural frequency at the first point. An oscillation is one track; where it splits into
        two decays, the second one is a separate track.
    """
    from scipy.optimize import linear_sum_assignment

    each_spectrum = spectra(systems, plant or Plant())
    orders = [np.arange(len(each_spectrum[0].eigenvalues))]
    tracked = replace(each_spectrum[0], right=each_spectrum[0].right.copy(), left=each_spectrum[0].left.copy())
    for spectrum in each_spectrum[1:]:
        overlap = np.abs(tracked.left @ spectrum.right) * np.abs(spectrum.left @ tracked.right).T
        distance = np.abs(tracked.eigenvalues[:, None] - spectrum.eigenvalues)
        scale = np.abs(tracked.eigenvalues[:, None]) + np.abs(spectrum.eigenvalues)
        cost = distance / np.maximum(scale, np.finfo(np.float64).tiny) - np.minimum(overlap, 1.0)
        order = linear_sum_assignment(cost)[1]
        orders.append(order)
        clear = overlap[np.arange(len(order)), order] > CLEAR
        tracked = Spectrum(
            spectrum.eigenvalues[order],
            np.where(clear, spectrum.right[:, order], tracked.right),
            np.where(clear[:, None], spectrum.left[order], tracked.left),
            spectrum.errors[order],
        )
    tracks = []
    for branch in np.array(orders).T:
        values = np.array([spectrum.eigenvalues[k] for spectrum, k in zip(each_spectrum, branch, strict=True)])
        if np.all(values.imag < 0):
            continue
        systems_modes = tuple(
            mode(system, spectrum, int(k), plant or Plant())
            for system, spectrum, k in zip(systems, each_spectrum, branch, strict=True)
        )
        tracks.append(ModeTrack(Counter(entry.label for entry in systems_modes).most_common(1)[0][0], systems_modes))
    tracks.sort(key=lambda track: track.modes[0].natural_frequency)
    labels = numbered([track.label for track in tracks])
    return tuple(replace(track, label=label) for track, label in zip(tracks, labels, strict=True))
