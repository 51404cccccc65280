"""The tuning page, as a person with a browser meets it; and what is behind it."""

from __future__ import annotations  # the robot's pytest does not export its fixtures' types

import shutil
import subprocess
import time
from contextlib import suppress
from pathlib import Path
from typing import Any, Dict, Iterator, List, NamedTuple

import cv2
import psutil
import pytest
import rosgraph
import yaml
from browser import Page, chromium, serving
from helpers import (
    ANSWER,
    REPOSITORY,
    SCENE,
    START,
    free_port,
    jpeg_of,
    load_launch,
    picture_of,
    run_program,
    wait_for,
)
from selenium.webdriver.common.keys import Keys
from unit.drawn import Scene

from obst_avoid.core.settings import SettingsError
from obst_avoid.offline import tool
from obst_avoid.offline.graph import MARK, launched
from obst_avoid.offline.tuning import settings as tuning
from obst_avoid.offline.tuning.result import result_of
from obst_avoid.offline.tuning.source import open_pictures, picture_at

BAG = REPOSITORY / 'build/test_data/simulated.bag'


@pytest.fixture(scope='module')
def pictures(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two: a duckie and a cone, and an empty road."""
    folder = tmp_path_factory.mktemp('pictures')
    (folder / 'a.jpg').write_bytes(jpeg_of(SCENE))
    (folder / 'b.jpg').write_bytes(jpeg_of(Scene(())))
    return folder


@pytest.fixture(scope='module')
def output(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp('tuned') / 'mine'


@pytest.fixture(scope='module')
def address(pictures: Path, output: Path) -> Iterator[str]:
    """Of the page over these pictures."""
    port = free_port()
    with serving(['rosrun', 'obst_avoid', 'tune', '--port', str(port), '--output', str(output), str(pictures)], port):
        yield 'http://127.0.0.1:%d' % port


@pytest.fixture(scope='module')
def browser() -> Iterator[Any]:
    with chromium() as opened:
        yield opened


@pytest.fixture
def page(browser: Any, address: str) -> Page:
    """Opened anew, with what a test before may have changed taken back."""
    opened = Page(browser, address)
    opened.wait('after-found', 'Found')
    wait_for(lambda: opened.take_back() or 'Nothing is changed' in opened.text('changes'), START, 'all taken back')
    return opened


class TestPage:
    def test_every_step_is_shown_before_and_after(self, page: Page, address: str) -> None:
        for side in ('before', 'after'):
            assert 'duckie 0.4' in page.wait('%s-found' % side, 'Found 2')
            assert 'SLOWING' in page.wait('%s-decision' % side, 'Standing here')
            table = page.wait('%s-table' % side, 'confidence')
            assert 'in our lane' in table and 'outside' in table and 'at least 0.60' in table
        wait_for(lambda: len(page.pictures()) == 24, ANSWER, 'eleven steps and the plan, twice')
        assert page.text('error') == ''
        assert 'Nothing is changed' in page.text('changes')
        sources = page.browser.execute_script('return performance.getEntriesByType("resource").map(e => e.name)')
        outside = [name for name in sources if not name.startswith((address, 'data:'))]
        assert not outside, 'nothing is fetched from elsewhere'

    def test_a_number_changes_the_right_side_only_and_can_be_taken_back(self, page: Page) -> None:
        page.enter('robust_confidence', 0.999)
        page.wait('after-found', 'Found nothing')
        assert 'Found 2' in page.text('before-found')
        assert 'less than 1.00' in page.wait('after-table', 'less than')
        assert 'robust_confidence 0.6 → 0.999' in page.wait('changes', 'Changed')
        page.browser.find_element('css selector', '#changes button').click()
        page.wait('after-found', 'Found 2')
        page.wait('changes', 'Nothing is changed')

    def test_the_avoider_s_stage_changes_the_plan(self, page: Page) -> None:
        page.enter('lane_width', 0.6)
        page.wait('after-decision', 'AVOIDING')
        assert 'SLOWING' in page.text('before-decision')
        page.choose('stage', 'stop_only')
        page.wait('after-decision', 'stage stop_only')
        page.choose('stage', 'avoid_all')
        page.enter('lane_width', 0.22)
        page.wait('changes', 'Nothing is changed')

    def test_the_other_profile_has_its_own_steps_and_sliders(self, page: Page) -> None:
        assert not page.browser.find_element('id', 'paper_yellow_low_hue').is_displayed()
        page.choose('profile', 'paper')
        page.wait('after-table', 'first eigenvalue')
        wait_for(lambda: len(page.pictures()) == 25, ANSWER, 'twelve steps beside eleven, and two plans')
        assert page.browser.find_element('id', 'paper_yellow_low_hue').is_displayed()
        page.enter('paper_yellow_high_hue', 16)
        page.wait('changes', 'paper_yellow_high_hue 35 → 16')
        wait_for(lambda: 'duckie' not in page.text('after-found'), ANSWER, 'no duckie of that yellow')
        page.enter('paper_yellow_high_hue', 35)
        page.choose('profile', 'robust')
        page.wait('changes', 'Nothing is changed')

    def test_what_no_node_would_start_with_is_not_taken(self, page: Page) -> None:
        page.enter('margin', -1)
        page.wait('error', 'not changed: obstacle_avoidance_node/margin = -1')
        assert 'expected a number >= 0 (m)' in page.text('error')
        assert 'Nothing is changed' in page.text('changes')

    def test_another_picture(self, page: Page) -> None:
        page.wait('choice', 'a.jpg (1 of 2)')
        page.click('next')
        page.wait('choice', 'b.jpg (2 of 2)')
        page.wait('after-found', 'Found nothing')
        page.click('previous')
        page.wait('after-found', 'Found 2')

    def test_saved_settings_are_those_of_every_tool(self, page: Page, output: Path, pictures: Path) -> None:
        page.enter('robust_confidence', 0.999)
        page.wait('changes', 'robust_confidence')
        page.click('save')
        saved = output / 'obstacle_detection_node.yaml'
        wait_for((output / 'simulation.yaml').is_file, ANSWER, 'the files')
        own = (REPOSITORY / 'config' / saved.name).read_text(encoding='utf-8').splitlines()
        lines = [(old, new) for old, new in zip(own, saved.read_text(encoding='utf-8').splitlines()) if old != new]
        assert [(old.split()[:2], new.split()[:2]) for old, new in lines] == [
            (['confidence:', '0.6'], ['confidence:', '0.999'])
        ], 'comments and all the others stay'
        call = ['rosrun', 'obst_avoid', 'detect_images', '--config', str(output), '--output', str(output / 'o.json')]
        ended = run_program([*call, str(pictures / 'a.jpg')], 60)
        assert ended.code == 0, ended.output
        assert yaml.safe_load((output / 'o.json').read_text())['images'][0]['obstacles'] == []
        saved.write_text('')
        page.enter('robust_confidence', 0.99)
        page.wait('changes', '0.99')
        page.click('save')
        wait_for(lambda: page.browser.find_elements('id', 'overwrite'), ANSWER, 'the question')
        assert saved.read_text() == '', 'nothing is overwritten before the answer'
        page.click('overwrite')
        wait_for(saved.read_text, ANSWER, 'the answer')
        page.enter('robust_confidence', 0.6)
        page.wait('changes', 'Nothing is changed')

    def test_nobody_else_can_reach_it(self, address: str) -> None:
        port = int(address.rsplit(':', 1)[1])
        listening = []
        for table in ('/proc/net/tcp', '/proc/net/tcp6'):
            for line in Path(table).read_text().splitlines()[1:]:
                local, state = line.split()[1], line.split()[3]
                if state == '0A' and int(local.split(':')[1], 16) == port:
                    listening.append(local.split(':')[0])
        assert listening == ['0100007F'], '127.0.0.1 alone'


class Running(NamedTuple):
    """A simulated robot, and the page over it. master: as seen by the tests. words: file of what the nodes said."""

    address: str
    environment: Dict[str, str]
    master: rosgraph.Master
    words: Path

    def parameter(self, name: str) -> Any:
        return self.master.getParam('/duck1/' + name)

    def said(self, words: str) -> List[str]:
        """Lines of the nodes with these words."""
        return [line for line in self.words.read_text(errors='replace').splitlines() if words in line]


@pytest.fixture(scope='module')
def running(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Running]:
    folder, port = tmp_path_factory.mktemp('robot'), free_port()
    words, output = folder / 'nodes.txt', str(folder / 'mine')
    call = ['rosrun', 'obst_avoid', 'tune', '--robot', 'duck1', '--port', str(port), '--output', output]
    with words.open('w') as log, launched(
        ['simulation.launch', 'veh:=duck1', 'picture_rate:=5'], log.fileno()
    ) as graph:
        master = rosgraph.Master('/test', graph.environment['ROS_MASTER_URI'])
        for node in tuning.NODES:
            wait_for(lambda node=node: _serves(master, '/duck1/%s/set_parameters' % node), START, node)
        with serving(call, port, graph.environment):
            yield Running('http://127.0.0.1:%d' % port, graph.environment, master, words)


def _serves(master: rosgraph.Master, service: str) -> bool:
    with suppress(OSError, rosgraph.MasterException):
        master.lookupService(service)
        return True
    return False


class TestRobot:
    @pytest.fixture
    def page(self, browser: Any, running: Running) -> Page:
        opened = Page(browser, running.address)
        opened.wait('after-decision', 'The robot: ')
        return opened

    def test_what_it_sees_and_decides(self, page: Page) -> None:
        page.wait('before-found', 'Found')
        assert page.text('calibration').endswith('config/calibrations/camera_extrinsic/default.yaml')
        wait_for(lambda: len(page.pictures()) == 24, ANSWER, 'eleven steps and the plan, twice')

    def test_a_number_reaches_the_one_node_that_it_belongs_to(self, page: Page, running: Running) -> None:
        for name, node, value in (
            ('cruise_speed', tuning.AVOIDER, 0.1),
            ('controller_cruise_speed', tuning.CONTROLLER, 0.15),
            ('robust_confidence', tuning.DETECTOR, 0.7),
        ):
            own = name.replace('controller_', '').replace('robust_', 'robust/')
            before = {other: running.parameter(other) for other in tuning.NODES}
            page.enter(name, value)
            wait_for(
                lambda own=own, node=node, value=value: running.parameter('%s/%s' % (node, own)) == value, ANSWER, name
            )
            after = {other: running.parameter(other) for other in tuning.NODES}
            assert [other for other in before if before[other] != after[other]] == [node]
            page.wait('changes', '→ %s' % value)
            assert page.text('error') == ''

    def test_a_slider_that_is_dragged_is_sent_once(self, page: Page, running: Running) -> None:
        before = len(running.said('stop_distance is'))
        page.drag('stop_distance', [5, 5, 5, 5, 5, 5])
        page.wait('changes', 'stop_distance 0.34')
        after = running.said('stop_distance is')
        assert len(after) == before + 1, after
        assert running.parameter(tuning.AVOIDER + '/stop_distance') > 0.34

    def test_a_number_is_sent_when_it_is_whole(self, page: Page, running: Running) -> None:
        field = page.browser.find_element('id', 'lane_width')
        field.send_keys(Keys.CONTROL + 'a')
        field.send_keys('0.2')
        time.sleep(1.0)
        field.send_keys('4' + Keys.ENTER)
        wait_for(lambda: running.parameter(tuning.AVOIDER + '/lane_width') == 0.24, ANSWER, 'the number')
        assert not running.said('lane_width is 0.2 now')
        field.send_keys(Keys.CONTROL + 'a')
        field.send_keys(Keys.BACKSPACE + Keys.TAB)
        wait_for(lambda: field.get_attribute('value') == '0.24', ANSWER, 'the number again, where none was given')

    def test_back_to_what_it_was(self, page: Page, running: Running) -> None:
        page.enter('near_distance', 0.5)
        wait_for(lambda: running.parameter(tuning.AVOIDER + '/near_distance') == 0.5, ANSWER, 'the number')
        page.wait('changes', 'near_distance')
        button = next(
            one for one in page.browser.find_elements('css selector', '#changes button') if 'near_distance' in one.text
        )
        button.click()
        wait_for(lambda: running.parameter(tuning.AVOIDER + '/near_distance') == 0.45, ANSWER, 'the one before')
        wait_for(lambda: 'near_distance' not in page.text('changes'), ANSWER, 'no change')

    def test_a_picture_that_is_held_does_not_hold_what_the_robot_says(self, page: Page, running: Running) -> None:
        wait_for(page.pictures, ANSWER, 'pictures')
        page.browser.find_element('css selector', '.q-toggle').click()
        camera = _process(running, 'simulator_node')
        camera.suspend()
        try:
            page.wait('after-decision', 'FAULT')
            assert page.pictures() and page.text('error') == ''
        finally:
            camera.resume()

    def test_what_the_node_would_not_start_with_is_not_sent(self, page: Page, running: Running) -> None:
        before = running.parameter(tuning.AVOIDER + '/margin')
        page.enter('margin', -1)
        page.wait('error', 'not changed: obstacle_avoidance_node/margin = -1')
        assert running.parameter(tuning.AVOIDER + '/margin') == before

    def test_a_camera_that_stops_leaves_no_old_pictures(self, page: Page, running: Running) -> None:
        wait_for(page.pictures, ANSWER, 'pictures')
        camera = _process(running, 'simulator_node')
        camera.suspend()
        try:
            page.wait('error', 'no picture of duck1 for ')
            assert page.pictures() == []
            assert page.text('after-found') == page.text('before-decision') == ''
            page.wait('after-decision', 'FAULT')
        finally:
            camera.resume()
        page.wait('after-found', 'Found')
        wait_for(lambda: page.text('error') == '', ANSWER, 'all is well again')

    def test_what_is_saved_starts_a_robot(self, page: Page, running: Running) -> None:
        page.click('save')
        files = running.words.with_name('mine')
        wait_for(lambda: page.text('error') or (files / 'simulation.yaml').is_file(), ANSWER, 'the files')
        assert page.text('error') == ''
        config = load_launch('obst_avoid.launch', veh='duck1', config=str(files))
        for name, own in (
            ('cruise_speed', 'obstacle_avoidance_node'),
            ('confidence', 'obstacle_detection_node/robust'),
        ):
            parameter = '%s/%s' % (own, name)
            assert config.params['/duck1/' + parameter].value == running.parameter(parameter)


def _process(running: Running, node: str) -> psutil.Process:
    """Of a node in that graph."""
    mark = running.environment[MARK]
    return next(
        process
        for process in psutil.process_iter(['cmdline'])
        if '__name:=' + node in (process.info['cmdline'] or []) and process.environ().get(MARK) == mark
    )


class TestErrors:
    @pytest.mark.parametrize(
        ('options', 'sentence'),
        [
            ([], 'expected pictures, a bag, or --robot NAME: one of these'),
            (['--robot', 'duck1', 'x.jpg'], 'expected pictures, a bag, or --robot NAME: one of these'),
            (['--robot', 'duck1', '--profile', 'paper'], '--config and --profile are not for --robot'),
            (['--robot', 'duck1'], 'no ROS master at http://localhost:1, expected that of duck1'),
            (['nowhere'], 'nowhere does not exist, expected a picture or a folder of pictures'),
            (['a.bag', 'b.jpg'], 'a.bag beside others, expected one bag, or pictures and folders'),
            (['nowhere.bag'], 'nowhere.bag does not exist, expected a bag'),
            (['--port', '0', 'x.jpg'], '--port 0, expected 1 to 65535'),
            (['--output', '/etc/passwd', 'x.jpg'], '/etc/passwd is no folder'),
            (['--config', 'nowhere', '{a}'], 'nowhere/obstacle_detection_node.yaml cannot be read'),
        ],
    )
    def test_one_sentence(self, options: List[str], sentence: str, pictures: Path) -> None:
        options = [option.format(a=pictures / 'a.jpg') for option in options]
        ended = run_program(['rosrun', 'obst_avoid', 'tune', *options], 60, {'ROS_MASTER_URI': 'http://localhost:1'})
        assert ended.code == 1, ended.output
        said = [line for line in ended.output.splitlines() if line.startswith('tune: ')]
        assert len(said) == 1 and sentence in said[0], ended.output
        assert 'Traceback' not in ended.output

    def test_a_port_that_is_taken(self, address: str, pictures: Path) -> None:
        port = address.rsplit(':', 1)[1]
        ended = run_program(['rosrun', 'obst_avoid', 'tune', '--port', port, str(pictures)], 60)
        assert ended.code == 1
        assert 'port %s is not to be had' % port in ended.output

    def test_without_nicegui_it_says_where_it_comes_from(self, pictures: Path) -> None:
        ended = run_program(['rosrun', 'obst_avoid', 'tune', str(pictures)], 60, {'OBST_AVOID_VENV': ''})
        assert ended.code == 1
        assert 'tune: NiceGUI is missing, expected it in build/venv: run make setup' in ended.output


class TestPictures:
    def test_of_a_folder(self, pictures: Path) -> None:
        found = open_pictures([str(pictures)], '')
        assert list(found.names) == ['a.jpg', 'b.jpg']
        assert picture_at(found, 1).shape == (480, 640, 3)

    def test_of_a_bag_in_any_order(self, tmp_path: Path) -> None:
        found = open_pictures([str(BAG)], '')
        last = len(found.names) - 1
        assert last > 50
        assert found.names[0] == '0.00 s'
        ended = run_program(['rosrun', 'obst_avoid', 'bag_to_images', '--output', str(tmp_path / 'out'), str(BAG)], 120)
        assert ended.code == 0, ended.output
        files = tool.picture_files([str(tmp_path / 'out')])
        for index in (last, 0, last // 2):
            expected = cv2.imread(files[index])
            assert (picture_at(found, index) == expected).all()


class TestSettings:
    @pytest.fixture
    def values(self) -> tuning.Values:
        return tuning.read('')

    def item(self, name: str) -> tuning.Tunable:
        return next(item for node in tuning.NODES for item in tuning.tunables(node) if item.name == name)

    def test_all_that_can_be_tuned_has_words_and_a_range_around_its_value(self, values: tuning.Values) -> None:
        items = [item for node in tuning.NODES for item in tuning.tunables(node)]
        assert {'stage', 'margin', 'lane_width', 'robust_confidence', 'paper_yellow_low_hue', 'bird_view_crop_distance'
                } <= {item.name for item in items}  # fmt: skip
        for item in items:
            assert item.about, item.name
            value = tuning.get(values, item)
            assert value in item.choices if item.choices else item.low <= value <= item.high, item.name

    def test_the_ends_of_all_ranges_and_all_choices_are_allowed(self, values: tuning.Values) -> None:
        for node in tuning.NODES:
            for item in tuning.tunables(node):
                for value in item.choices or (item.low, item.high):
                    assert tuning.get(tuning.with_change(values, item, value), item) == value

    def test_a_change_is_checked_and_leaves_the_others(self, values: tuning.Values) -> None:
        with pytest.raises(SettingsError, match=r'lane_width = 0, expected a number > 0 \(m\)'):
            tuning.with_change(values, self.item('lane_width'), 0)
        after = tuning.with_change(values, self.item('paper_yellow_low_hue'), 20.0)
        assert tuning.differences(values, after) == [(self.item('paper_yellow_low_hue'), 15, 20)]
        assert tuning.differences(values, values) == []

    def test_settings_of_a_robot_are_saved_in_the_package_s_files(self, values: tuning.Values, tmp_path: Path) -> None:
        parameters = {**values[tuning.AVOIDER], 'margin': 0.05, 'veh': 'duck1', 'msgs_package': ''}
        known = {tuning.AVOIDER: tuning.from_parameters(parameters, tuning.AVOIDER)}
        tuning.save(known, '', str(tmp_path))
        assert tool.avoidance_settings(str(tmp_path), None).margin == 0.05
        own = (REPOSITORY / 'config/obstacle_detection_node.yaml').read_text()
        assert (tmp_path / 'obstacle_detection_node.yaml').read_text() == own

    def test_a_result_says_why_each_blob_counts_or_not(self, values: tuning.Values) -> None:
        result = result_of(picture_of(SCENE), tool.default_calibration(), values)
        assert [(row['kind'], row['counts']) for row in result.rows[:2]] == [('duckie', 'yes'), ('cone', 'yes')]
        assert all(row['why'] and row['numbers'] for row in result.rows)
        assert [name.split()[0] for name, _ in result.panels] == [str(number) for number in range(1, 13)]


def test_the_program_is_found() -> None:
    assert shutil.which('rosrun')
    ended = subprocess.run(['rosrun', 'obst_avoid', 'tune', '--help'], stdout=subprocess.PIPE, check=False)
    assert ended.returncode == 0
    assert b'127.0.0.1' in ended.stdout
