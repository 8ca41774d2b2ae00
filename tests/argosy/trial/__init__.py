import pytest

pytest.register_assert_rewrite("tests.argosy.trial.networks")
