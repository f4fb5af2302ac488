from tests.studies import few_scenarios, fewest_scenarios, make_problem

__all__ = ["few_scenarios", "fewest_scenarios", "make_problem"]
