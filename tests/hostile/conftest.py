"""Good files, made once; a test breaks copies of them."""

import pytest
from victims import make_victims


@pytest.fixture(scope="session")
def victims(tmp_path_factory):
    return make_victims(tmp_path_factory.mktemp("victims"))
