"""Rewrite the committed answers, on purpose: PYTHONPATH=src:test /usr/bin/python3 -m golden.refresh

Look at the difference before committing it, and say in the commit why it changed.
"""

import json

from golden.recording import PATH, replayed


def main() -> None:
    """Replay the recording and write what came out."""
    PATH.write_text(json.dumps(replayed(), indent=1) + '\n')
    print('%s written' % PATH)


if __name__ == '__main__':
    main()
