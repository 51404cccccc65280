"""The page: sliders on the left, before and after side by side on the right. NiceGUI draws it and keeps it in step."""

import base64
import os
import threading
from typing import Any, Callable, Dict, List, Optional, Sequence, Tuple

import cv2
from nicegui import app, run, ui

from obst_avoid.core.calibration import Calibration, CalibrationError
from obst_avoid.core.detection.settings import PROFILES
from obst_avoid.core.picture import PictureError
from obst_avoid.core.settings import SettingsError
from obst_avoid.core.types import Array
from obst_avoid.offline import tool
from obst_avoid.offline.tuning import settings as tuning
from obst_avoid.offline.tuning.result import Result, result_of
from obst_avoid.offline.tuning.robot import Robot
from obst_avoid.offline.tuning.settings import AVOIDER, CONTROLLER, DETECTOR, Tunable, Values
from obst_avoid.offline.tuning.source import Pictures, picture_at, title_of
from obst_avoid.ros.border import BorderError

PERIOD = 0.2
"""[s] between two looks at whether something has changed: a slider that is dragged changes all the time."""
PATIENCE = 30.0
"""[s] that a page may be silent: on a machine with much to do, clicks were lost with NiceGUI's 3 s."""
LIVE_PERIOD = 1.0
"""[s] between two pictures of a running robot."""
WIDEST = 800
"""[px] of a picture on the page."""
SIDES = ('before', 'after')
MOST_STEPS = 12
"""Of all profiles."""
ROWS = 8
"""Of the table at a time."""
ERRORS = (tool.ToolError, SettingsError, CalibrationError, PictureError, BorderError, OSError)
COLUMNS = [
    {'name': name, 'label': label, 'field': name, 'align': 'left'}
    for name, label in (
        ('counts', 'counts'), ('kind', 'kind'), ('place', 'where'), ('why', 'why'), ('numbers', 'what was measured'),
    )
]  # fmt: skip
GROUPS = (
    ('profile', 'Detector'), ('bird_view_', 'Region'), ('robust_', 'Profile robust'), ('paper_', 'Profile paper'),
)  # fmt: skip
"""How the detector's settings are grouped, by how their names begin."""


class Desk:
    """What is on the table: a source of pictures or a robot, and the settings before and after."""

    def __init__(
        self,
        calibration: Calibration,
        config: str,
        profile: Optional[str],
        output: str,
        source: Optional[Pictures],
        robot: Optional[Robot],
    ) -> None:
        self.calibration, self.config, self.output = calibration, config, output
        self.source, self.robot = source, robot
        self.before: Values = tuning.read(config) if robot is None else robot.values()
        if profile:
            self.before = {**self.before, DETECTOR: {**self.before[DETECTOR], 'profile': profile}}
        self.after = self.before
        self.index = 0
        self._changing = threading.Lock()

    def picture(self) -> Array:
        """The one that is looked at. Raises what ERRORS has."""
        if self.robot is not None:
            return self.robot.picture()
        assert self.source is not None
        return picture_at(self.source, self.index)

    def title(self) -> str:
        """Of what."""
        return 'robot %s' % self.robot.veh if self.robot is not None else title_of(self.source or Pictures(()))

    def change(self, item: Tunable, value: Any) -> None:
        """Take another value, or say why not. Raises SettingsError, ToolError; nothing is changed then."""
        with self._changing:  # a robot takes its time, and meanwhile something else may be moved
            after = tuning.with_change(self.after, item, value)
            if self.robot is not None and tuning.get(after, item) != tuning.get(self.after, item):
                self.robot.change(item, tuning.get(after, item))
            self.after = after

    def save(self) -> List[str]:
        """Write the settings. Returns the paths. Raises OSError, SettingsError."""
        return tuning.save(self._everything(), self.config, self.output)

    def existing(self) -> List[str]:
        """Files that would be written over."""
        return tuning.existing(self._everything(), self.output)

    def _everything(self) -> Values:
        return self.after if self.robot is None else {**self.after, **self.robot.others()}


def serve(desk: Desk, port: int, ready: Callable[[], None]) -> None:
    """Serve the page on 127.0.0.1 until Ctrl-C."""

    @ui.page('/')
    def _page() -> None:
        Page(desk).build()

    app.on_startup(ready)
    ui.run(
        host='127.0.0.1',
        port=port,
        show=False,
        reload=False,
        title='obst_avoid tune',
        favicon='🦆',
        reconnect_timeout=PATIENCE,
        show_welcome_message=False,
    )


class Page:
    """One tab of a browser."""

    def __init__(self, desk: Desk) -> None:
        self._desk = desk
        self._shown: Dict[str, Any] = {}
        self._picture: Optional[Array] = None
        self._panels: Dict[str, List[Tuple[Any, Any, Any]]] = {side: [] for side in SIDES}
        self._results: Dict[str, Result] = {}
        self._stale, self._hold, self._busy, self._failed = True, False, False, False
        self._controls: Dict[Tuple[str, str], List[Any]] = {}
        self._connections = 0
        self._different: Optional[List[Any]] = None

    def build(self) -> None:
        """Lay everything out."""
        desk = self._desk
        ui.context.client.on_connect(lambda: self._count(1))
        ui.context.client.on_disconnect(lambda: self._count(-1))
        ui.add_css('.q-table td { white-space: normal; vertical-align: top } .nicegui-content { max-width: none }')
        with ui.header().classes('items-center q-py-xs'):
            ui.label('obst_avoid: %s' % desk.title()).classes('text-h6')
            ui.space()
            if desk.robot is None:
                self._build_choice()
            else:
                ui.switch('hold the picture', on_change=lambda event: setattr(self, '_hold', event.value)).props(
                    'color=orange dark'
                )
            ui.button('Save', icon='save', on_click=self._save).props('color=white text-color=primary id=save')
        with ui.left_drawer(value=True, bordered=True).props('width=420').classes('q-pa-sm'):
            self._build_settings()
        ui.label('Calibration: %s' % desk.calibration.source).classes('text-caption').props('id=calibration')
        self._error = ui.label().classes('text-negative text-bold').props('id=error')
        with ui.row().classes('w-full items-center').props('id=changes') as self._changes:
            pass
        with ui.grid(columns=2).classes('w-full gap-x-4 gap-y-1'):  # row by row, so that what belongs together is level
            for side in SIDES:
                ui.label(side.capitalize()).classes('text-h6')
            for side in SIDES:
                with ui.column().classes('gap-0'):
                    self._shown[side, 'found'] = ui.label().props('id=%s-found' % side)
                    self._shown[side, 'decision'] = ui.label().props('id=%s-decision' % side)
            self._build_panels(1)
            for side in SIDES:
                table = ui.table(columns=COLUMNS, rows=[], pagination=ROWS).classes('w-full self-start')
                self._shown[side, 'table'] = table.props('dense wrap-cells flat bordered id=%s-table' % side)
            self._build_panels(MOST_STEPS)
        ui.timer(PERIOD, self._look)
        if desk.robot is not None:
            ui.timer(LIVE_PERIOD, self._next_live)

    def _count(self, more: int) -> None:
        """Of connections: a browser that comes back may be heard of before its old one has gone."""
        self._connections += more

    def _build_panels(self, count: int) -> None:
        """So many rows of a title and a picture for each side."""
        for _ in range(count):
            for side in SIDES:
                with ui.column().classes('gap-0 w-full') as cell:
                    title = ui.label().classes('text-caption')
                    image = ui.image().classes('w-full').props('loading=eager no-spinner no-transition')
                self._panels[side].append((cell, title, image))

    def _build_choice(self) -> None:
        """Which picture."""
        desk = self._desk
        names = list(desk.source.names) if desk.source is not None else []

        def choose(index: int) -> None:
            desk.index = min(max(index, 0), len(names) - 1)
            self._picture, self._stale = None, True
            self._choice.set_text('%s (%d of %d)' % (names[desk.index], desk.index + 1, len(names)))
            self._slider.value = desk.index

        ui.button(icon='chevron_left', on_click=lambda: choose(desk.index - 1)).props('flat color=white id=previous')
        self._slider = (
            ui.slider(min=0, max=max(len(names) - 1, 1), step=1, value=desk.index)
            .props('color=white')
            .classes('w-64')
            .on('update:model-value', lambda event: choose(int(event.args)), throttle=PERIOD, leading_events=False)
        )
        ui.button(icon='chevron_right', on_click=lambda: choose(desk.index + 1)).props('flat color=white id=next')
        self._choice = ui.label().props('id=choice')
        choose(desk.index)

    def _build_settings(self) -> None:
        desk = self._desk
        detector = tuning.tunables(DETECTOR)
        groups = {
            start: self._build_group(title, [item for item in detector if item.name.startswith(start)])
            for start, title in GROUPS
        }
        profile = self._controls[DETECTOR, 'profile'][0]
        for name in PROFILES:  # those of the other one change nothing
            groups[name + '_'].bind_visibility_from(profile, 'value', value=name)
        self._build_group('Avoider', tuning.tunables(AVOIDER))
        if desk.robot is not None and CONTROLLER in desk.after:
            self._build_group('Lane controller', tuning.tunables(CONTROLLER))

    def _build_group(self, title: str, items: List[Tunable]) -> Any:
        with ui.expansion(title, value=True).classes('w-full').props('dense header-class=text-bold') as group:
            for item in items:
                self._build_control(item)
        return group

    def _build_control(self, item: Tunable) -> None:
        """A slider and a number, or words to choose from. What is wrong is said at the top, and not taken."""
        value = tuning.get(self._desk.after, item)

        async def changed(event: Any) -> None:
            if event.value is not None and event.value != tuning.get(self._desk.after, item):
                await self._change(item, event.value)

        async def meant(event: Any) -> None:
            try:
                await self._change(item, float(event.args))
            except ValueError:  # an empty field
                self._show_value(item)

        with ui.row().classes('w-full items-center no-wrap gap-2'):
            label = ui.label(_short(item)).classes('w-44 text-caption')
            label.tooltip(item.about)
            if item.choices:
                controls = [ui.select(list(item.choices), value=value, on_change=changed).props('dense')]
            else:
                step = 1 if item.kind == 'int' else _step(item)
                slider = ui.slider(min=item.low, max=item.high, step=step, value=value)
                number = ui.number(value=value, step=step).props('dense debounce=300').classes('w-24')
                if self._desk.robot is None:
                    slider.on_value_change(changed)
                    number.on_value_change(changed)
                else:  # a robot that drives is told what was meant, not what the slider or the typing came by
                    slider.on('change', meant)
                    number.on('change', meant)
                controls = [slider.props('dense').classes('grow'), number]
            controls[-1].props('for=%s' % _identity(item))
        self._controls[item.node, item.name] = controls

    async def _change(self, item: Tunable, value: Any) -> None:
        try:
            if self._desk.robot is None:
                self._desk.change(item, value)
            else:
                await run.io_bound(self._desk.change, item, value)
        except ERRORS as error:
            self._error.set_text('not changed: %s' % error)
            self._show_value(item)
            return
        self._error.set_text('')
        self._show_value(item)
        self._show_changes()
        self._stale = True

    def _show_value(self, item: Tunable) -> None:
        for control in self._controls[item.node, item.name]:
            control.value = tuning.get(self._desk.after, item)

    def _show_changes(self) -> None:
        """What is different, each with a way back."""
        different = tuning.differences(self._desk.before, self._desk.after)
        if different == self._different:  # a button that is made anew under the mouse is not pressed
            return
        self._different = different
        self._changes.clear()
        with self._changes:
            ui.label('Changed:' if different else 'Nothing is changed yet: move a slider.').classes('text-bold')
            for item, old, new in different:
                words = '%s %s → %s' % (_identity(item), old, new)
                ui.button(words, icon='undo', on_click=lambda _, item=item, old=old: self._change(item, old)).props(
                    'no-caps dense outline size=sm'
                )

    def _next_live(self) -> None:
        assert self._desk.robot is not None
        if not self._hold:
            self._picture, self._stale = None, True
        self._shown['after', 'decision'].set_text('The robot: %s' % self._desk.robot.decision())

    async def _look(self) -> None:
        """Compute and draw again what is not true any more; one at a time."""
        if not self._stale or self._busy or self._connections < 1:  # nobody looks
            return
        self._stale, self._busy = False, True
        failing = SIDES
        try:
            desk = self._desk
            picture, index = self._picture, desk.index
            if picture is None:
                picture = await run.io_bound(desk.picture)
                if index != desk.index:  # another one was chosen meanwhile
                    self._stale = True
                    return
                self._picture = picture
                self._results.clear()
            for side, values in (('before', desk.before), ('after', desk.after)):
                if side == 'before' and side in self._results:
                    continue
                failing = (side,)
                result = await run.io_bound(result_of, picture, desk.calibration, values)
                self._results[side] = result
                self._draw(side, result)
            if self._failed:
                self._error.set_text('')
            self._failed = False
            self._show_changes()
        except ERRORS as error:
            self._error.set_text(tool.why_os(error) if isinstance(error, OSError) else str(error))
            self._failed = True
            self._clear(failing)
        finally:
            self._busy = False

    def _clear(self, sides: Sequence[str]) -> None:
        """Nothing is better than what is not true any more."""
        for side in sides:
            self._results.pop(side, None)
            self._shown[side, 'found'].set_text('')
            if self._desk.robot is None or side == 'before':
                self._shown[side, 'decision'].set_text('')
            self._shown[side, 'table'].rows = []
            self._shown[side, 'table'].update()
            for cell, _, _ in self._panels[side]:
                cell.set_visibility(False)

    def _draw(self, side: str, result: Result) -> None:
        self._shown[side, 'found'].set_text('Found %s' % result.found)
        if self._desk.robot is None or side == 'before':
            self._shown[side, 'decision'].set_text('Standing here: %s' % result.decision)
        table = self._shown[side, 'table']
        table.rows = [{'id': number, **row} for number, row in enumerate(result.rows)]
        table.update()
        order = [result.panels[-1], *result.panels[:-1]]  # what comes of it first
        for number, (cell, title, image) in enumerate(self._panels[side]):
            cell.set_visibility(number < len(order))
            if number < len(order):
                title.set_text(order[number][0])
                image.set_source(_url(order[number][1]))

    def _save(self) -> None:
        there = self._desk.existing()
        if not there:
            self._write()
            return
        with ui.dialog(value=True) as dialog, ui.card():
            ui.label('%s has %s already.' % (os.path.abspath(self._desk.output), ', '.join(there)))
            with ui.row():
                ui.button('Overwrite', on_click=lambda: (dialog.close(), self._write())).props('id=overwrite')
                ui.button('Leave it', on_click=dialog.close).props('flat')

    def _write(self) -> None:
        try:
            paths = self._desk.save()
        except ERRORS as error:
            self._error.set_text('not saved: %s' % (tool.why_os(error) if isinstance(error, OSError) else error))
            return
        ui.notify('Saved %d files to %s' % (len(paths), os.path.abspath(self._desk.output)), type='positive')


def _short(item: Tunable) -> str:
    """The name without its group's, in words."""
    name = item.name
    for start, _ in GROUPS:
        if name.startswith(start) and name != start:
            name = name[len(start) :]
    return name.replace('_', ' ')


def _identity(item: Tunable) -> str:
    """Of all tunables: avoider and controller share names."""
    return 'controller_' + item.name if item.node == CONTROLLER else item.name


def _step(item: Tunable) -> float:
    """About a hundredth of the range, a round number."""
    width = item.high - item.low
    return 0.001 if width <= 0.1 else 0.01 if width <= 3 else 0.1 if width <= 20 else 1.0


def _url(picture: Array) -> str:
    """A picture inside the page; masks without loss."""
    if picture.shape[1] > WIDEST:
        height = round(picture.shape[0] * WIDEST / picture.shape[1])
        picture = cv2.resize(picture, (WIDEST, height), interpolation=cv2.INTER_AREA)
    kind = 'png' if picture.ndim == 2 else 'jpeg'
    data = cv2.imencode('.' + kind, picture)[1].tobytes()
    return 'data:image/%s;base64,%s' % (kind, base64.b64encode(data).decode('ascii'))
