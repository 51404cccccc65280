"""What the .cfg files share: a settings file's values by flat names, with their comments, for dynamic_reconfigure."""

import os
import sys

import yaml
from dynamic_reconfigure.parameter_generator_catkin import ParameterGenerator, bool_t, double_t, int_t, str_t

ROOT = os.path.dirname(os.path.dirname(os.path.abspath(__file__)))
sys.path.insert(0, os.path.join(ROOT, 'src'))
from obst_avoid.core.settings_text import described, flat, value_at

TYPES = {bool: bool_t, float: double_t, int: int_t, str: str_t}


def generate(node, name, files, ranges):
    """Write the classes of one node's live tuning. Returns the exit code.

    files: in config/. ranges: by flat name what a slider offers, (lowest, highest), or the words to choose from; what
    is allowed is said by the settings' own checks, which refuse with a sentence.
    """
    settings, comments = {}, {}
    for file in files:
        with open(os.path.join(ROOT, 'config', file), encoding='utf-8') as opened:
            text = opened.read()
        settings.update(yaml.safe_load(text))
        comments.update({item.path: item.comment for item in described(text)})
    paths, gen = flat(settings), ParameterGenerator()
    for parameter, offered in ranges.items():
        path = paths[parameter]
        value = value_at(settings, path)
        words = isinstance(value, str)
        said = next((comments[path[:end]] for end in range(len(path), 0, -1) if comments.get(path[:end])), '')
        said = said.replace('"', '').replace("'", '')  # the generator takes none
        choice = gen.enum([gen.const(word, str_t, word, '') for word in offered], said) if words else ''
        low, high = (None, None) if words else offered
        gen.add(parameter, TYPES[type(value)], 0, said, value, low, high, choice)
    return gen.generate('obst_avoid', node, name)
