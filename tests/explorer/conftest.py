"""One server and one browser for all tests of the page."""

import pytest
from visiting import CHROMIUM, FLAGS, PHYSICAL, Server, Visit

from creative_nao.explorer.favourites import SessionFile
from creative_nao.schema import save_json


@pytest.fixture(scope="package")
def server(tmp_path_factory):
    running = Server(tmp_path_factory.mktemp("explorer"), words=["--physical", str(PHYSICAL)])
    yield running
    running.stop()


@pytest.fixture(autouse=True)
def no_favourite_stays(request):
    """Leave the one server without favourites: the next test may look for its own."""
    yield
    if "server" in request.fixturenames:
        save_json(request.getfixturevalue("server").session, SessionFile(1, ()), indent=1, private=True)


@pytest.fixture(scope="package")
def playwright_run():
    if CHROMIUM is None:
        pytest.skip("no Chromium; install your distribution's package `chromium`")
    from playwright.sync_api import sync_playwright

    with sync_playwright() as running:
        yield running


@pytest.fixture(scope="package")
def browser(playwright_run):
    opened = playwright_run.chromium.launch(executable_path=CHROMIUM, args=FLAGS)
    yield opened
    opened.close()


@pytest.fixture
def visit(browser):
    """Open tabs that are closed, and must be without fault, at the end of the test."""
    opened = []

    def open_tab(url, **options):
        opened.append(Visit(browser, url, **options))
        return opened[-1]

    yield open_tab
    for one in opened:
        one.context.close()
        assert not one.errors
