"""Simulated joint errors of the floor views have their stated covariance."""

from __future__ import annotations

import numpy as np

from surefoot.experiments.support.floor_views import random_view


def test_the_error_of_the_prior_has_its_stated_covariance():
    rng = np.random.default_rng(0)
    views = [random_view(rng, (0.3, 1.5), (10.0, 40.0)) for _ in range(400)]
    errors = np.array([view.prior.error_to(view.floor) for view in views])
    stated = np.sqrt(np.diag(views[0].prior.covariance))
    np.testing.assert_allclose(errors.std(axis=0), stated, rtol=0.15)
