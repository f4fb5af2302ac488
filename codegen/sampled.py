"""Sampled systems as named CasADi functions, for the compiled drivers."""

from dataclasses import dataclass, field

import casadi as ca


@dataclass(frozen=True)
class Sampled:
    """A sampled system with continuous motion between the samples.

    The state begins with the continuous part, `motion`; the rest is `discrete` and changes at a sample. All functions
    have dense SX expressions.

    Attributes:
        sample: ``sample(state, exogenous, parameters) -> (discrete, hold)``: the discrete state at the next sample,
            and the values held constant until then (zero-order hold).
        observe: ``observe(state, exogenous, parameters) -> row``: a row of the result.
        move: ``move(motion, hold, part, parameters) -> (next_motion, margin)``: the motion over one of `parts` equal
            parts of the sample interval, number 0 to parts − 1; a run ends where the `margin` of the last part is
            negative.
        parts: number of these parts.
        one_step: ``one_step(motion, hold, parameters) -> (next_motion, margin, valid)``: the motion over the sample
            interval in one step, cheaper than all parts and used wherever ``valid > 0``; or None.
        fast_sample: ``fast_sample(state, exogenous, parameters) -> (discrete, hold)``: the same as `sample` wherever
            the state `phase` is not 0, without the code that has no effect there; or None.
        phase: index of that state.
    """

    sample: ca.Function
    observe: ca.Function
    move: ca.Function
    parts: int
    one_step: ca.Function | None
    fast_sample: ca.Function | None = field(default=None, kw_only=True)
    phase: int = field(default=0, kw_only=True)

    @property
    def functions(self) -> tuple[ca.Function, ...]:
        """All functions there are."""
        optional = (function for function in (self.one_step, self.fast_sample) if function)
        return (self.sample, self.observe, self.move, *optional)

    @property
    def sizes(self) -> dict[str, int]:
        """Sizes of the vectors, by the names of their C macros."""
        moving = self.move.numel_in("motion")
        return {
            "STATES": self.sample.numel_in("state"),
            "MOTION": moving,
            "EXOGENOUS": self.sample.numel_in("exogenous"),
            "PARAMETERS": self.sample.numel_in("parameters"),
            "HOLD": self.sample.numel_out("hold"),
            "COLUMNS": self.observe.numel_out("row"),
            "PARTS": self.parts,
            "HAS_ONE_STEP": int(self.one_step is not None),
            "HAS_FAST_SAMPLE": int(self.fast_sample is not None),
            "PHASE": self.phase,
        }
