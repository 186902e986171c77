# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The system's Chromium without a network, for tests of pages."""

import json
import shlex
import shutil
import time

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


def until(driver, script, *arguments):
    """Wait until a script returns something true; return it."""
    end = time.monotonic() + 30.0
    while time.monotonic() < end:
        found = driver.execute_script(f'return {script}', *arguments)
        if found:
            return found
        time.sleep(0.05)
    raise AssertionError(f'never true: {script}')


def prefer(driver, scheme):
    """Prefer 'light' or 'dark' colours."""
    feature = {'name': 'prefers-color-scheme', 'value': scheme}
    driver.execute_cdp_cmd('Emulation.setEmulatedMedia', {'features': [feature]})


def on_screen(driver, page, width, scheme='light'):
    """Show a page of ours in a window of this width, until its plots are drawn."""
    driver.get_log('performance')
    prefer(driver, scheme)
    driver.execute_cdp_cmd(
        'Emulation.setDeviceMetricsOverride',
        {'width': width, 'height': 900, 'deviceScaleFactor': 1, 'mobile': width < 500},
    )
    driver.get(page.as_uri())
    until(driver, 'window.Bokeh && Bokeh.documents.length && Bokeh.documents[0].is_idle')


def asked_for(driver):
    """The addresses outside of the page that it asked for since it was shown."""
    asked = [json.loads(line['message'])['message'] for line in driver.get_log('performance')]
    urls = {
        event['params']['request']['url']
        for event in asked
        if event['method'] == 'Network.requestWillBeSent'
    }
    assert urls  # the page itself
    return {url for url in urls if not url.startswith(('file:', 'data:', 'blob:'))}
