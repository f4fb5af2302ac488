"""Studies in a journal: budget, first trials, resuming, refusals, and what a killed process leaves."""

from pathlib import Path

import optuna
import pytest
from optuna.storages.journal import JournalFileBackend

from dualwinch.model.errors import ConfigurationError
from dualwinch.tuning.optimisers import optimiser
from dualwinch.tuning.problem import TuningProblem
from dualwinch.tuning.scoring.evaluation import Evaluator
from dualwinch.tuning.scoring.progress import SearchStatus
from dualwinch.tuning.scoring.ranking import Evaluation
from dualwinch.tuning.scoring.training_set import prepare
from dualwinch.tuning.storage.opening import open_store, stored_definition
from dualwinch.tuning.storage.store import MemoryStorage, StudyStorage
from dualwinch.tuning.study import Search, SearchBudget
from dualwinch.tuning.tuning_problem import definition_of
from tests.studies import MakeProblem


def studied(
    problem: TuningProblem, file: Path, trials: int, *, method: str = "cmaes", resume: bool = False
) -> list[Evaluation]:
    store = open_store(str(file), "s", problem, definition_of(problem, method), resume=resume)
    prepared = prepare(problem)
    Search(method, optimiser(method, prepared, 0), store, Evaluator(prepared)).run(SearchBudget(trials))
    found = store.finished()
    store.close()
    return found


def test_a_study_has_its_trials_the_papers_gains_first_and_is_reproducible(
    make_problem: MakeProblem, tmp_path: Path
) -> None:
    start = ["simulation.duration=0.1", "controller.nftsm.beta=0.2"]
    problem = make_problem(settings=start, scenarios=2)
    found = studied(problem, tmp_path / "a", 37)
    assert [trial.number for trial in found] == list(range(37))
    assert [trial.candidate.origin for trial in found[:3]] == ["paper", "start", "cmaes"]
    assert (found[0].point, found[1].point) == (problem.paper_point, problem.start)
    assert min(trial.objectives for trial in found) < found[0].objectives
    assert studied(problem, tmp_path / "b", 37) == found


def test_optuna_reads_the_file_with_units_and_constraints(make_problem: MakeProblem, tmp_path: Path) -> None:
    problem = make_problem(scenarios=4)
    found = studied(problem, tmp_path / "a", 20)
    backend = JournalFileBackend(str(tmp_path / "a"))
    study = optuna.load_study(study_name="s", storage=optuna.storages.JournalStorage(backend))
    assert {trial.state.name for trial in study.trials} == {"COMPLETE", "PRUNED"}
    first = study.trials[0]
    assert first.values == list(found[0].objectives)
    assert first.constraints == found[0].violations
    assert first.user_attrs["mean.mse [m^2]"] == found[0].objectives[0]
    assert first.user_attrs["outcomes"] == {"completed": 6}, "in the draws and the cuts"


def test_a_study_goes_on_when_asked_and_after_a_kill(make_problem: MakeProblem, tmp_path: Path) -> None:
    problem, file = make_problem(scenarios=2), tmp_path / "a"
    before = studied(problem, file, 20)
    with pytest.raises(ConfigurationError, match="has 20 trials; continue with --resume"):
        studied(problem, file, 30)
    with pytest.raises(ConfigurationError, match="unknown study 'ss'; did you mean 's'"):
        stored_definition(str(file), "ss")
    with file.open("ab") as torn:
        torn.write(b'{"op_code":4,"worker_id"')  # a process was killed while it wrote
    after = studied(problem, file, 30, resume=True)
    assert len(after) == 30
    assert after[:20] == before


def test_another_problem_is_refused_and_the_difference_is_said(make_problem: MakeProblem, tmp_path: Path) -> None:
    file = tmp_path / "a"
    studied(make_problem(scenarios=1), file, 4)
    for words, message in (
        ({"space": ["controller.nftsm.beta=0.01:1:log"]}, "has another space: .*controller.nftsm.beta is 0.01 to 1"),
        (
            {"seed": 4},
            f"^{file}: study 's' was begun with another seed: 4 here, 3 there; give another --out or --study$",
        ),
        ({"objectives": ["mean.mae"]}, r"with other objectives: \['mean.mae'\] here"),
    ):
        with pytest.raises(ConfigurationError, match=message):
            studied(make_problem(**({"scenarios": 1} | words)), file, 8, resume=True)
    store = open_store(str(file), "other", make_problem(), definition_of(make_problem(), "cmaes"), resume=False)
    with pytest.raises(ConfigurationError, match="another process is writing it"):
        studied(make_problem(scenarios=1), file, 8, resume=True)
    store.close()


@pytest.mark.parametrize("text", ["hello\n", "t,x\n1,2", "t,x", "5\n", '{"x": 1}\n', '{"x": 1}', "[]"])
def test_a_file_that_is_no_journal_is_refused_and_left_as_it_is(
    text: str, make_problem: MakeProblem, tmp_path: Path
) -> None:
    file = tmp_path / "text"
    file.write_text(text)
    with pytest.raises(ConfigurationError, match="is not the journal of a study"):
        studied(make_problem(scenarios=1), file, 1)
    with pytest.raises(ConfigurationError, match="is not the journal of a study"):
        stored_definition(str(file), "s")
    assert file.read_text() == text


def test_processes_join_a_study_each_with_a_budget_of_its_own(make_problem: MakeProblem, tmp_path: Path) -> None:
    """In SQLite's file, as in any other database: each searches elsewhere, and learns of the other's trials."""
    problem, url = make_problem(scenarios=1), f"sqlite:///{tmp_path}/study.db"
    definition, prepared = definition_of(problem, "random"), prepare(problem)

    def joined(*, resume: bool = False) -> StudyStorage:
        return open_store(url, "s", problem, definition, resume=resume)

    def searched(store: StudyStorage, trials: int) -> SearchStatus:
        proposer = optimiser("random", prepared, problem.stream(store.stream))
        return Search("random", proposer, store, Evaluator(prepared)).run(SearchBudget(trials))

    first, second = joined(), joined()
    assert first.stream != second.stream
    assert searched(first, 20).trials == 20
    assert searched(second, 20).trials == 40
    assert [trial.number for trial in first.news()] == list(range(20, 40))
    assert first.news() == []
    trials = first.finished()
    assert [trial.number for trial in trials] == list(range(40))
    assert len({tuple(trial.point.values()) for trial in trials}) == 40
    continued = joined(resume=True)
    assert searched(continued, 45).trials == 45
    assert stored_definition(url, "s") == definition
    for store in (first, second, continued):
        store.close()


def test_time_is_a_budget(make_problem: MakeProblem) -> None:
    problem = make_problem(scenarios=1)
    store, prepared = MemoryStorage(), prepare(problem)
    Search("random", optimiser("random", prepared, 0), store, Evaluator(prepared)).run(SearchBudget(until=0))
    assert store.count() == 0


def test_another_laws_first_trial_is_its_own_start(make_problem: MakeProblem, tmp_path: Path) -> None:
    settings = ["simulation.duration=0.1", "controller.kind=adrc"]
    problem = make_problem(settings=settings, space=["controller.adrc"], scenarios=1)
    found = studied(problem, tmp_path / "a", 4)
    assert [trial.candidate.origin for trial in found[:2]] == ["start", "cmaes"]
    assert found[0].point == problem.start


def test_rollouts_are_a_budget_and_checks_count(make_problem: MakeProblem) -> None:
    """The last batch has so few candidates that it goes beyond the budget by no more than its cuts and a check."""
    prepared = prepare(make_problem(scenarios=4))
    evaluator, store = Evaluator(prepared), MemoryStorage()
    progress = Search("cmaes", optimiser("cmaes", prepared, 0), store, evaluator).run(SearchBudget(rollouts=1000))
    options = prepared.problem.options
    assert progress.spent == evaluator.rollouts
    assert progress.spent > sum(trial.scenarios for trial in store.finished())
    assert any(trial.pruned and trial.scenarios == 1 for trial in store.finished())
    assert 1000 <= progress.spent < 1000 + 4 + options.cuts * options.generation + options.chunk
    assert progress.share == 1
