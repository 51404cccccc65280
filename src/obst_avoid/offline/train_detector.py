"""train_detector: grow the trees of the profile robust from labelled pictures."""

import argparse
import functools
import os
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from typing import Any, Dict, List, Optional, Tuple

import cv2
import numpy as np

from obst_avoid.core.detection.robust.trees import Forest
from obst_avoid.core.picture import PictureError
from obst_avoid.core.settings import read_yaml
from obst_avoid.offline import tool
from obst_avoid.offline.training.samples import Dataset, Samples, read_datasets, read_labels, samples_of

Work = Tuple[Dataset, Dict[str, Any], List[Dict[str, Any]], int]


def main(arguments: Any = None) -> int:
    """Entry point."""
    parser = argparse.ArgumentParser(
        prog='train_detector',
        description='Grow the trees of the profile robust from labelled pictures, real or rendered (docs/detector.md).',
    )
    parser.add_argument('--hold-out', metavar='TEXT', nargs='+', default=[], help='leave out blocks whose name has it')
    parser.add_argument('--jobs', type=tool.count, default=1, help='pictures at the same time (default: 1)')
    parser.add_argument('--output', metavar='FILE', required=True, help='trees.npz to write')
    parser.add_argument(
        'datasets', metavar='DATASETS', help='YAML list: labels, pictures, calibration, vehicle, copies'
    )
    return tool.run(_main, parser, arguments)


def _main(options: argparse.Namespace) -> int:
    if not options.output.endswith('.npz'):
        raise tool.ToolError('--output %s, expected a name that ends in .npz' % options.output)
    tool.new_file(options.output)
    fit = _fit()
    work: List[Work] = []
    for dataset in read_datasets(options.datasets, read_yaml(options.datasets)):
        for picture, annotations in read_labels(dataset):
            if not any(text in str(picture.get('split_block', '')) for text in options.hold_out):
                work += [(dataset, picture, annotations, copy) for copy in range(dataset.copies)]
    threads = os.cpu_count() or 1
    with ProcessPoolExecutor(options.jobs, get_context('spawn'), _start) as workers:
        looked = _measured(workers, work, None, 'looking')
        if not any(fit.things(item).any() for item in looked):
            raise tool.ToolError('%s: no region of any picture is a labelled thing' % options.datasets)
        first = fit.first_of(looked, threads)
        samples = _measured(workers, work, first, 'measuring')
    if not any(np.isfinite(item.radius[fit.things(item)]).any() for item in samples):
        raise tool.ToolError('%s: no label has x, y and radius, expected a rendered data set' % options.datasets)
    fit.write(dict(fit.grown(samples, threads), first=first), options.output)
    print(
        '%d pictures, %d regions, %d of them promising, %d of these things: %s'
        % (
            len(looked),
            sum(len(item.box) for item in looked),
            sum(len(item.box) for item in samples),
            sum(int(fit.things(item).sum()) for item in samples),
            options.output,
        )
    )
    return 0


def _fit() -> Any:
    """The module that grows trees: the only one that needs XGBoost, so that nothing else asks for it."""
    try:
        from obst_avoid.offline.training import fit
    except ImportError as error:
        if error.name != 'xgboost':
            raise
        raise tool.ToolError('xgboost is missing, expected it from: /usr/bin/python3 -m pip install xgboost') from error
    return fit


def _start() -> None:
    cv2.setNumThreads(1)


def _measured(workers: Any, work: List[Work], first: Optional[Forest], name: str) -> List[Samples]:
    results = workers.map(functools.partial(_samples, first=first), work, chunksize=8)
    return [item for item in tool.progress(results, name, len(work)) if item is not None]


def _samples(work: Work, first: Optional[Forest]) -> Optional[Samples]:
    try:
        return samples_of(*work, first)
    except PictureError as error:
        raise tool.ToolError(str(error)) from error
