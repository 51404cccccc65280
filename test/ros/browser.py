"""Headless Chromium over a page that a program of ours serves, for tests."""

import shutil
import socket
import subprocess
import tempfile
from contextlib import contextmanager, suppress
from typing import Any, Callable, Dict, Iterator, List, Optional, Sequence

import pytest
from helpers import ANSWER, START, free_port, wait_for
from selenium.common.exceptions import (
    ElementClickInterceptedException,
    InvalidElementStateException,
    NoSuchElementException,
    StaleElementReferenceException,
)
from selenium.webdriver import ActionChains, Chrome
from selenium.webdriver.chrome.options import Options
from selenium.webdriver.chrome.service import Service
from selenium.webdriver.common.keys import Keys


@contextmanager
def chromium(width: int = 1400, height: int = 1200) -> Iterator[Chrome]:
    """A browser without a screen. Skips where there is none."""
    driver = shutil.which('chromedriver')
    if driver is None:
        pytest.skip('no chromedriver: deps/install desktop')
    options = Options()
    for argument in ('--headless=new', '--no-sandbox', '--disable-gpu', '--disable-dev-shm-usage'):
        options.add_argument(argument)
    options.add_argument('--window-size=%d,%d' % (width, height))
    browser = Chrome(service=Service(driver), options=options)
    try:
        yield browser
    finally:
        browser.quit()


class Page:
    """What a person sees of the tuning page, and does with it."""

    def __init__(self, browser: Chrome, url: str) -> None:
        self.browser = browser
        browser.get(url)

    def text(self, identity: str) -> str:
        """Of one element; '' while it is not there."""
        try:
            return ' '.join(element.text for element in self.browser.find_elements('id', identity))
        except StaleElementReferenceException:
            return ''

    def wait(self, identity: str, words: str) -> str:
        """Until an element's text has these words."""
        try:
            wait_for(lambda: words in self.text(identity), START, words)
        except AssertionError as error:
            raise AssertionError('#%s has %r, expected %r' % (identity, self.text(identity), words)) from error
        return self.text(identity)

    def click(self, identity: str) -> None:
        """A button."""
        self._until(lambda: self.browser.find_element('id', identity).click(), 'a button to click: %s' % identity)

    def enter(self, identity: str, value: Any) -> None:
        """A number, in place of the one before."""

        def typed() -> None:
            field = self.browser.find_element('id', identity)
            field.send_keys(Keys.CONTROL + 'a')  # the key is released at the end of a call
            field.send_keys(str(value) + Keys.TAB)

        self._until(typed, 'a field to type in: %s' % identity)

    def choose(self, identity: str, word: str) -> None:
        """One of a list of words."""
        self.click(identity)

        def click_option() -> None:
            options = self.browser.find_elements('css selector', '.q-menu .q-item')
            found = [option for option in options if option.text == word]
            if not found:
                raise NoSuchElementException(word)
            found[0].click()

        self._until(click_option, '%s in the list' % word)
        wait_for(lambda: not self.browser.find_elements('css selector', '.q-menu'), ANSWER, 'the list is closed')

    @staticmethod
    def _until(act: Callable[[], None], what: str) -> None:
        """Do it as soon as what it is done to is there: much of a page moves before it can be touched."""

        def done() -> bool:
            with suppress(InvalidElementStateException, NoSuchElementException, StaleElementReferenceException,
                          ElementClickInterceptedException):  # fmt: skip
                act()
                return True
            return False

        wait_for(done, ANSWER, what)

    def take_back(self) -> None:
        """Click the first of what was changed, if anything was."""
        if self.browser.find_elements('css selector', '#changes button'):
            with suppress(NoSuchElementException, StaleElementReferenceException):
                self.browser.find_element('css selector', '#changes button').click()

    def drag(self, identity: str, pixels: Sequence[int]) -> None:
        """The slider beside a field, by so many pixels to the right, one move after the other."""
        field = self.browser.find_element('id', identity)
        thumb = field.find_element('xpath', 'ancestor::*[.//*[@role="slider"]][1]//*[@role="slider"]')
        actions = ActionChains(self.browser).click_and_hold(thumb)
        for step in pixels:
            actions = actions.move_by_offset(step, 0).pause(0.2)
        actions.release().perform()

    def pictures(self) -> List[int]:
        """Widths [px] of the pictures that are shown and have come whole."""
        script = """return [...document.querySelectorAll('img')].filter(i => i.offsetParent)
            .map(i => i.complete ? i.naturalWidth : 0)"""
        return [width for width in self.browser.execute_script(script) if width]


@contextmanager
def serving(
    call: Sequence[str], port: int, environment: Optional[Dict[str, str]] = None
) -> Iterator['subprocess.Popen[bytes]']:
    """A program that serves a page, until the block is left; it is asked to end as by Ctrl-C, and must."""
    import signal

    with tempfile.TemporaryFile() as log:
        process = subprocess.Popen(list(call), stdout=log, stderr=subprocess.STDOUT, env=environment)
        try:

            def answers() -> bool:
                if process.poll() is not None:
                    log.seek(0)
                    raise AssertionError('%s ended: %s' % (call, log.read().decode()))
                with socket.socket() as probe:
                    return probe.connect_ex(('127.0.0.1', port)) == 0

            wait_for(answers, START, 'a page')
            yield process
            process.send_signal(signal.SIGINT)
            process.wait(START)
            log.seek(0)
            said = log.read().decode()
            assert 'Traceback' not in said, said
        finally:
            if process.poll() is None:
                process.kill()
                process.wait()


__all__ = ['Page', 'chromium', 'free_port', 'serving']
