from tests.studies import make_problem

__all__ = ["make_problem"]
