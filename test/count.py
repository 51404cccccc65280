"""Add up the JUnit files of a test run; print the closing line; fail when a test failed or too few ran."""

import collections
import os
import sys
from xml.etree import ElementTree

EXPECTED = 8200
"""Tests that must have run, skipped ones not counted. Raise it when tests are added."""
EXPECTED_FILES = 16
"""JUnit files that must be there: a rostest that never started writes none."""


def main(folder: str) -> int:
    """Count all `*.xml` below folder."""
    files = [os.path.join(at, name) for at, _, names in os.walk(folder) for name in names if name.endswith('.xml')]
    count = collections.Counter(passed=0, failed=0, skipped=0)
    for path in files:
        for case in ElementTree.parse(path).iter('testcase'):
            tags = {child.tag for child in case}
            count['failed' if tags & {'failure', 'error'} else 'skipped' if 'skipped' in tags else 'passed'] += 1
    short = []
    if len(files) < EXPECTED_FILES:
        short.append('%d result files, expected at least %d' % (len(files), EXPECTED_FILES))
    if count['passed'] + count['failed'] < EXPECTED:
        short.append('%d tests ran, expected at least %d' % (count['passed'] + count['failed'], EXPECTED))
    for sentence in short:
        print('test/count.py: ' + sentence)
    print('%(passed)d passed, %(failed)d failed, %(skipped)d skipped' % count)
    return 1 if short or count['failed'] else 0


if __name__ == '__main__':
    sys.exit(main(sys.argv[1]))
