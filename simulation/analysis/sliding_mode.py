"""Experiments whose position law is a sliding mode of the paper: what some analyses are about."""

from dualwinch.controllers.laws.fando_nftsm import FandoNftsm
from dualwinch.controllers.laws.nftsm import Nftsm
from dualwinch.model.errors import ConfigurationError
from dualwinch.simulation.experiment import Experiment


def sliding_mode(experiment: Experiment, reason: str = "must be") -> FandoNftsm | Nftsm:
    """The sliding-mode law of an experiment.

    Args:
        experiment: whose law is wanted.
        reason: what the error says before the kinds that are allowed.

    Raises:
        ConfigurationError: it has another law.
    """
    law = experiment.controller.law
    if not isinstance(law, FandoNftsm | Nftsm):
        raise ConfigurationError(f'controller.kind = "{law.kind}": {reason} "{FandoNftsm.kind}" or "{Nftsm.kind}"')
    return law
