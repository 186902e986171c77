# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The system's Chromium without a network, for tests of pages."""

import shlex
import shutil

import pytest

DRIVER = shutil.which('chromedriver')
BROWSER = (
    shutil.which('chromium') or shutil.which('chromium-browser') or shutil.which('google-chrome')
)


def start():
    """A headless browser; skips the test, with the reason, where there is none."""
    if not DRIVER or not BROWSER:
        pytest.skip('not run: no chromium and chromedriver on this machine')
    selenium = pytest.importorskip('selenium', reason='not run: selenium is not installed')
    from selenium import webdriver
    from selenium.webdriver.chrome.service import Service

    options = webdriver.ChromeOptions()
    options.binary_location = BROWSER
    for flag in (
        *shlex.split(
            '--headless=new --no-sandbox --disable-gpu --disable-dev-shm-usage '
            '--window-size=1200,1600'
        ),
        '--host-resolver-rules=MAP * ~NOTFOUND',
    ):
        options.add_argument(flag)
    options.set_capability('goog:loggingPrefs', {'browser': 'ALL', 'performance': 'ALL'})
    try:
        return webdriver.Chrome(options=options, service=Service(DRIVER))
    except selenium.common.exceptions.WebDriverException as error:
        pytest.skip(f'not run: the browser does not start: {error.msg}')
