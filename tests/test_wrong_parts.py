"""What users write wrongly, and what they read: one line that says which part, what, and what to write instead."""

from pathlib import Path

import pytest

from dualwinch.config.plugins import load_plugin
from dualwinch.model.errors import ConfigurationError
from dualwinch.simulation.batch.rollout import rollout
from dualwinch.simulation.paper import case
from dualwinch.simulation.settings import override
from dualwinch.simulation.simulate import simulate
from tests.spring_law import changed

FROZEN = "@dataclass(frozen=True)"
LAW = f"{FROZEN}\nclass Spring"
STEP = "step(self, state, estimate, setpoint, context)"
GIVEN = "return Memory(e1), SpringOutput(u=u, u_sat=u_sat, stretch=e1)"


def run(file: Path) -> None:
    """Run the law of a file."""
    load_plugin(str(file))
    simulate(override(case(4), {"controller.kind": "spring", "simulation.duration": 0.01}))


def read(folder: Path, text: str) -> str:
    """The error of a run with a law that somebody wrote."""
    file = folder / "law.py"
    file.write_text(text)
    with pytest.raises(ConfigurationError) as caught:
        run(file)
    message = str(caught.value)
    assert "\n" not in message
    return message


@pytest.mark.parametrize(
    ("written", "message"),
    [
        (
            (LAW, "class Spring"),
            "Spring of law.py: write @dataclass(frozen=True) right above the class",
        ),
        (
            ("import dataclass", "import dataclass as frozen_by_name"),
            "plugin law.py: line 11: NameError: name 'dataclass' is not defined",
        ),
        (
            ('    kind: ClassVar = "spring"\n', ""),
            'Spring of law.py: has no kind; write kind: ClassVar = "spring"',
        ),
        (
            ('kind: ClassVar = "spring"', 'kind: str = "spring"'),
            "Spring of law.py: kind must be no field; write kind: ClassVar = ...",
        ),
        (
            ('kind: ClassVar = "spring"', 'kind: ClassVar = "my spring"'),
            "Spring of law.py: kind = 'my spring' must be of letters, digits and single hyphens; write kind: ClassVar",
        ),
        (
            ("def step(", "def stepp("),
            f"Spring of law.py: has no step; write def {STEP}",
        ),
        (
            ('"by hand"), dw.Tunable(10, 1e5)] = 5e3', '"by hand"), dw.Tunable(10, 1e5)]'),
            "Spring of law.py: stiffness has no default; write stiffness: Annotated[...] = ...",
        ),
        (
            ('label: ClassVar = "spring and damper"', 'label: str = "spring and damper"'),
            "Spring of law.py: label must be no field; write label: ClassVar = ...",
        ),
        (
            ("def initial_state(", "def initial("),
            "Spring of law.py: has no initial_state; write def initial_state(self)",
        ),
        (
            ("return Memory()", "return Memory(np.zeros(2))"),
            "spring: e of its initial_state is an array; must be a number, as it is annotated",
        ),
        (
            (STEP, "step(self, state, estimate, setpoint)"),
            f"Spring of law.py: its step takes other arguments; write def {STEP}",
        ),
        (
            ('damping: Annotated[float, at.Ge(0), dw.Quantity("N s/m", "force at 1 m/s")]', "damping: float"),
            'Spring.damping has no Quantity; write damping: Annotated[float, Quantity("unit", "meaning")]',
        ),
        (
            ('e: Annotated[float, dw.Quantity("m", "tracking error of the last sample")]', "e: float"),
            'Memory.e has no Quantity; write e: Annotated[float, Quantity("unit", "meaning")]',
        ),
        (
            ("at.Ge(0)", "at.MultipleOf(2)"),
            "Spring.damping: MultipleOf(multiple_of=2) is no bound; use Gt, Ge, Lt, Le or Interval, and a Rule",
        ),
        (
            ('kind: ClassVar = "spring"', 'kind: ClassVar = "pid-cascade"'),
            "position law 'pid-cascade' is dualwinch.controllers.laws.pid_cascade.PidCascade; give Spring of law.py",
        ),
        (
            ('kind: ClassVar = "spring"', 'kind: ClassVar = "estimator"'),
            "Spring of law.py: the key controller.estimator is taken by Controller; give the part another kind",
        ),
        (
            ("class Spring(dw.PositionLaw)", "class Spring(dw.Nothing)"),
            "plugin law.py: line 22: AttributeError: No dualwinch attribute Nothing",
        ),
        (
            ("return Memory()", "return None"),
            "spring: its initial_state gives None; must give a dataclass of numbers, vectors and matrices",
        ),
        (
            (GIVEN, "return SpringOutput(u=u, u_sat=u_sat, stretch=e1)"),
            "spring: its step gives a SpringOutput; must give (state, PositionOutput)",
        ),
        (
            (GIVEN, "return Memory(e1), u"),
            "spring: its step gives a SX as output; must be a PositionOutput",
        ),
        (
            (GIVEN, "return None, SpringOutput(u=u, u_sat=u_sat, stretch=e1)"),
            "spring: its step gives None as next state; must be a Memory",
        ),
        (
            (GIVEN, "import casadi\n        return Memory(casadi.vertcat(e1, e2)), SpringOutput(u, u_sat, e1)"),
            "spring: e of its Memory is an array; must be a number, as it is annotated",
        ),
        (
            (GIVEN, "import casadi\n        return state, SpringOutput(casadi.vertcat(u, u), u_sat, e1)"),
            "spring: u of its SpringOutput is an array; must be a number, as it is annotated",
        ),
        (
            ("u_sat = clip(u, -context.limits.force, context.limits.force)", "u_sat = u if u < 1e3 else 1e3"),
            "spring: its step asks for the value of a symbol; use where(condition, a, b)",
        ),
        (
            ("u_sat = clip(u, -context.limits.force, context.limits.force)", "u_sat = min(u, 1e3)"),
            "spring: its step asks for the value of a symbol; use where(condition, a, b)",
        ),
        (
            (
                "u_sat = clip(u, -context.limits.force, context.limits.force)",
                "import math\n        u_sat = math.sin(u)",
            ),
            "spring: its step asks for the value of a symbol; use functions of dualwinch.model.scalar or casadi",
        ),
        (
            (
                "u_sat = clip(u, -context.limits.force, context.limits.force)",
                "import numpy\n        u_sat = float(numpy.array(u))",
            ),
            "spring: its step asks for the value of a symbol; use functions of dualwinch.model.scalar or casadi",
        ),
        (
            ("stretch", "e"),
            "signal 'e': the name is taken by a column of every result",
        ),
        (
            ("stretch", "saturated"),
            "signal 'saturated': the name is taken by an output of every controller",
        ),
        (
            ("] = 2e4", "] = (1.0, 2.0)"),
            "controller.spring.damping = (1.0, 2.0): must be a finite number >= 0 N s/m",
        ),
        (
            ("] = 2e4", "] = field(default_factory=lambda: np.ones(2))"),
            "controller.spring.damping: is an array; must be a number, or a tuple of numbers",
        ),
        (
            ("] = 2e4", "] = np.ones(2)"),
            "plugin law.py: line 21: ValueError: mutable default <class 'numpy.ndarray'> for field damping",
        ),
        (
            ("damping: Annotated[float", "damping: Annotated[tuple[float, ...]"),
            "controller.spring.damping = 20000.0: must be a list of finite numbers >= 0 N s/m",
        ),
    ],
)
def test_what_they_wrote_and_what_they_read(tmp_path: Path, written: tuple[str, str], message: str) -> None:
    numpy = ("from dataclasses import dataclass", "from dataclasses import dataclass, field\nimport numpy as np")
    assert message in read(tmp_path, changed(numpy, written))


def test_a_first_state_that_asks_a_gain_for_its_value(tmp_path: Path) -> None:
    """Batches work it out as a function of the gains, over symbols."""
    file = tmp_path / "law.py"
    file.write_text(changed(("return Memory()", "return Memory(0.0 if self.damping > 1e3 else 1.0)")))
    load_plugin(str(file))
    experiment = override(case(4), {"controller.kind": "spring", "simulation.duration": 0.01})
    with pytest.raises(
        ConfigurationError, match=r"^spring: its initial_state asks for the value of a symbol; use where"
    ):
        rollout(["controller.spring.damping"], [[1e4]], [experiment])


def test_a_list_is_no_tuple(tmp_path: Path) -> None:
    file = tmp_path / "law.py"
    file.write_text(
        changed(("damping: Annotated[float", "damping: Annotated[tuple[float, ...]"), ("= 2e4", "= (2e4,)"))
    )
    load_plugin(str(file))
    experiment = override(case(4), {"controller.kind": "spring"})
    law = type(experiment.controller.law)
    with pytest.raises(
        ConfigurationError, match=r"^controller\.spring\.damping: is a list; must be a number, or a tuple"
    ):
        case(4, law=law(damping=[1.0, 2.0]))  # pyright: ignore[reportCallIssue]
    assert hash(case(4, law=law(damping=(1.0, 2.0))))  # pyright: ignore[reportCallIssue]
