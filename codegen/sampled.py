"""A sampled system as named CasADi functions: what the compiled drivers run."""

from dataclasses import dataclass

import casadi as ca


@dataclass(frozen=True)
class Sampled:
    """A system that is sampled, and moves on between two samples.

    The state begins with what moves between two samples, `motion`; the rest is `discrete` and changes at a sample.
    All functions are of dense SX expressions.

    Attributes:
        sample: ``sample(state, exogenous, parameters) -> (discrete, held)``: the discrete state at the next sample,
            and what is held until then.
        observe: ``observe(state, exogenous, parameters) -> row``: what a result keeps of a sample.
        move: ``move(motion, held, part, parameters) -> (next_motion, margin)``: the motion over one of `parts` equal
            parts of the time until the next sample, number 0 to parts − 1; a run ends where the last one's `margin`
            is negative.
        parts: number of these parts.
        leap: ``leap(motion, held, parameters) -> (next_motion, margin, valid)``: cheaper than all parts, with the
            same result wherever ``valid > 0``; or None.
    """

    sample: ca.Function
    observe: ca.Function
    move: ca.Function
    parts: int
    leap: ca.Function | None

    @property
    def functions(self) -> tuple[ca.Function, ...]:
        """All functions there are."""
        return (self.sample, self.observe, self.move, *((self.leap,) if self.leap else ()))

    @property
    def sizes(self) -> dict[str, int]:
        """Sizes of the vectors, by the names of their C macros."""
        moving = self.move.numel_in("motion")
        return {
            "STATES": self.sample.numel_in("state"),
            "MOTION": moving,
            "EXOGENOUS": self.sample.numel_in("exogenous"),
            "PARAMETERS": self.sample.numel_in("parameters"),
            "HELD": self.sample.numel_out("held"),
            "COLUMNS": self.observe.numel_out("row"),
            "PARTS": self.parts,
            "HAS_LEAP": int(self.leap is not None),
        }
