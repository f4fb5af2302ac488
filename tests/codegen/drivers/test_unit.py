"""Translation units are written once, whichever process needs them."""

from collections.abc import Callable
from pathlib import Path
from types import ModuleType
from typing import Any

import casadi as ca
import pytest

from dualwinch import codegen
from dualwinch.codegen import native
from dualwinch.codegen.drivers import batch, rollout, stepping, unit
from dualwinch.codegen.drivers.stepping import Commanded
from dualwinch.codegen.drivers.unit import recipe
from tests.codegen.toy import oscillator

anew = oscillator.__wrapped__
"""The functions of the oscillator as another process builds them."""


def squared(factor: float = 1.0) -> ca.Function:
    x = ca.SX.sym("x")
    return ca.Function("squared", [x], [factor * x * x], ["x"], ["y"])


def stepped(**options: Any) -> Any:
    observation = ca.SX.sym("state", 3), ca.SX.sym("exogenous", 1), ca.SX.sym("parameters", 3)
    names = ["state", "exogenous", "parameters"]
    sense = ca.Function("sense", [*observation], [observation[0][0]], names, ["observation"])
    return stepping.compile_stepping(Commanded(anew(), sense, ((1,),)), **options)


@pytest.mark.parametrize(
    ("module", "writer", "compiled"),
    [
        (rollout, "rollout_source", lambda: rollout.compile_rollout(anew())),
        (rollout, "rollout_source", lambda: rollout.compile_rollout(anew(), generator="casadi")),
        (batch, "batch_source", lambda: batch.compile_batch(anew())),
        (batch, "rows_source", lambda: batch.compile_batch(anew(), rows=True)),
        (stepping, "stepping_source", lambda: stepped(exact=False)),
        (native, "_source", lambda: native.compile(squared())),
    ],
)
def test_what_is_known_is_not_written_again(
    module: ModuleType, writer: str, compiled: Callable[[], Any], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setenv("DUALWINCH_CACHE_DIR", str(tmp_path))
    first = compiled()
    monkeypatch.setattr(module, writer, lambda *_, **__: pytest.fail("is written again"))
    again = compiled()
    for name in ("columns", "read", "constants"):
        assert getattr(first, name, None) == getattr(again, name, None)


def test_a_recipe_is_of_functions_options_and_what_writes() -> None:
    first = recipe((squared(),), "batch", 4)
    assert first == recipe((squared(),), "batch", 4)
    others = recipe((squared(2.0),), "batch", 4), recipe((squared(),), "rollout", 4), recipe((squared(),), "batch", 5)
    assert len({first, *others}) == 4


def test_what_writes_is_all_of_codegen_and_casadi(monkeypatch: pytest.MonkeyPatch) -> None:
    read = []
    whole = Path.read_text
    monkeypatch.setattr(Path, "read_text", lambda self, **words: read.append(self) or whole(self, **words))
    before = unit._version.__wrapped__()
    folder = Path(codegen.__file__).resolve().parent
    assert {path.resolve() for path in read} == {
        path for path in folder.rglob("*.*") if path.suffix in {".py", ".c", ".h"}
    }
    monkeypatch.setattr(ca.CasadiMeta, "version", lambda: "another")
    assert unit._version.__wrapped__() != before
