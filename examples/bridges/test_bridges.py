"""Runs each bridge with the real process. The environment variable PINGMAP names the program.

A test is skipped, by name, if the program or a package is absent.
"""

import json
import os
import queue
import threading
import time
import tty
from functools import reduce

import pytest
from configuration import own_slots
from pingmap_process import Pingmap

pytestmark = pytest.mark.skipif(not os.environ.get("PINGMAP"), reason="PINGMAP does not name the program")

SLOT_S = 1.0
MEMBERS = ["auv1", "auv2", "auv3"]
MODEL = """
schema = 6
depths = false
[chart]
origin_east_m = 700.0
origin_north_m = 600.0
scale_m = 500.0
latitude_deg = 54.0
longitude_deg = 10.0
[prior_mean]
kind = "range"
intercept = 3.4
slope_per_m = 0.006
[fading]
correlation = 0.0
memory_s = 10.0
drift_m_per_s = 0.15
[[kernel]]
shape = "matern32"
variance = 3.4
columns = ["range"]
length_scale_m = 481.0
[learned]
from = "a test"
log_digest = "38ed1f7a509c61f02908c91e64745dd7"
structure = "range"
events = 800
events_used = 800
evidence = -0.3
leave_one_out = -0.3
variance_factor = 2.0
stop = "converged"
"""
TEAM = """
schema = 4
model_file = "model.toml"
log_digest = "38ed1f7a509c61f02908c91e64745dd7"
epoch = 0
frame_bytes = 32
packets_per_sender_max = 64
reports_per_sender_max = 256
transmissions_max = 8
track_tolerance_m = 12.0
extrapolation_s_max = 120.0
min_gain_nats = 0.00003
exclusion_threshold_sd = 4.5
[members]
auv1 = 0
auv2 = 1
auv3 = 2
[grid]
cell_m = 24.0
depth_cell_m = 1.0
start_s = {start_s}
time_cell_s = 64.0
[slots]
start_s = {start_s}
duration_s = {slot_s}
order = ["auv1", "auv2", "auv3"]
[limits]
events_max = 100000
dense_events_max = 1200
inducing_points_max = 256
candidates_max = 1000
pending_events_max = 256
report_window_slots = 16384
"""
VEHICLE = """
schema = 1
vehicle = "{name}"
team = "team.toml"
[slots]
settle_s = 0.4
[modem_ids]
1 = "auv1"
2 = "auv2"
3 = "auv3"
[log]
level = "warn"
"""


@pytest.fixture
def start_s():
    """Begin of the schedule: a minute ago, so that a vehicle can have a history."""
    return round(time.time()) - 60.0


@pytest.fixture
def config(tmp_path, start_s):
    """Returns a function that writes the configuration of a member."""
    (tmp_path / "model.toml").write_text(MODEL)
    (tmp_path / "team.toml").write_text(TEAM.format(start_s=start_s, slot_s=SLOT_S))

    def write(name):
        path = tmp_path / f"{name}.toml"
        path.write_text(VEHICLE.format(name=name))
        return path

    return write


def feed_history(pingmap, start_s, slots=45):
    """Feeds the past to a vehicle that lies still, and hears one member and not the other."""
    name = pingmap.hello["vehicle"]
    heard = next(member for member in MEMBERS if member != name)
    for slot in range(slots):
        time_s, sender = start_s + slot * SLOT_S + 0.1, MEMBERS[slot % 3]
        answers = [pingmap.call({"type": "nav", "time": time_s, "position": {"x": 700, "y": 600}})]
        if sender == heard:
            answers.append(pingmap.call({"type": "heard", "time": time_s, "from": sender}))
        if sender == name:
            answers.append(pingmap.call({"type": "sent", "time": time_s}))
        assert all(answer["type"] == "ok" for answer in answers), answers


def frame_of(config, name, start_s):
    """Returns a real frame of a member, as hexadecimal digits."""
    pingmap = Pingmap(config(name))
    feed_history(pingmap, start_s)
    frame = pingmap.call({"type": "frame_request", "time": start_s + 45, "bytes": 32})
    pingmap.stop()
    assert frame["type"] == "frame", frame
    return frame["bytes"]


class Record:
    """All answers of a process, with their requests."""

    def __init__(self):
        self.all = []

    def __call__(self, request, answer):
        self.all.append((request or {}, answer))

    def wait_for(self, is_wanted, timeout_s=30):
        deadline = time.time() + timeout_s
        while time.time() < deadline:
            for request, answer in list(self.all):
                if is_wanted(request, answer):
                    return answer
            time.sleep(0.02)
        pytest.fail(f"no such answer among {self.all}")

    def errors(self):
        return [pair for pair in self.all if pair[1]["type"] == "error"]


def test_the_shared_client_greets_calls_and_stops(config, start_s):
    path, record = config("auv2"), Record()
    pingmap = Pingmap(path, record)
    assert (pingmap.hello["vehicle"], pingmap.hello["version"]) == ("auv2", 1)
    feed_history(pingmap, start_s)
    assert pingmap.call({"type": "no such"})["code"] == "unknown_type"
    for line in ("{", "[]", '{"type": 5}', '{"time": 1}'):
        pingmap.send_line(line)
        assert record.all[-1][0] == line and record.all[-1][1]["code"] == "not_json"
    pingmap.send_line('{"type": "status"}')
    assert pingmap.call({"type": "status"})["store"] == {"state": "stored"}
    assert pingmap.stop()["inputs"] == pingmap.lines
    assert pingmap.process.returncode == 0
    assert {answer["heard"] for _, answer in record.all if answer["type"] == "event"} == {True, False}
    assert own_slots(path) == (start_s + SLOT_S, 3 * SLOT_S, SLOT_S)
    assert not pingmap.open


def sentence(text):
    return f"${text}*{reduce(lambda sum, byte: sum ^ byte, text.encode(), 0):02X}\r\n".encode()


class SimulatedModem(threading.Thread):
    """A Micro-Modem at the other end of a pseudo-terminal. It is simulated: no sound and no real modem."""

    def __init__(self):
        super().__init__(daemon=True)
        self.end, other = os.openpty()
        tty.setraw(other)
        self.port, self.commands, self.sent, self.is_failing = os.ttyname(other), [], queue.Queue(), False
        self.start()

    def say(self, *texts):
        for text in texts:
            os.write(self.end, sentence(text))
            time.sleep(0.005)

    def run(self):
        for line in os.fdopen(self.end, "rb", buffering=0, closefd=False):
            text = line.decode().strip()[1:].split("*")[0]
            assert line == sentence(text), "the checksum of the host"
            name, *fields = text.split(",")
            self.commands.append(text)
            if name == "CCCFQ":
                self.say("CACFG,SRC,1")
            elif name == "CCCFG":
                self.say("CACFG," + ",".join(fields))
            elif name == "CCCYC":
                self.say("CACYC," + ",".join(fields), "CATXP,0", "CATXF,0", self.statistics(0))
                self.say("CADRQ,120000,1,15,0,32,1")
            elif name == "CCTXD" and self.is_failing:
                self.say("CAERR,120000,DATA_TIMEOUT,1")
            elif name == "CCTXD":
                self.sent.put(fields[3])
                self.say("CATXD,1,15,0,32", "CATXP,32", "CATXF,32", self.statistics(32))

    def statistics(self, n_bytes):
        return f"CAXST,6,20260503,120005.0000,0,0,200,5000,25000,0,1,15,0,1,1,2,{n_bytes}"

    def receive(self, source, data):
        """Plays the reception of a message of one frame at rate 0."""
        arrival, quality = "20260503120100.8357,06,32767,45,0102,0123,07,00,00,00,00", "26.0,9.5,-100,-6.5,-1,0.01"
        statistics = f"CACST,7,0,{arrival},0,{source},15,0,1,1,0,150,{quality},51,25000,5000"
        self.say(f"CACYC,0,{source},15,0,0,1", "CARXP,1", f"CARXD,{source},15,0,1,{data}", statistics)


def wait_until(time_s):
    time.sleep(max(0, time_s - time.time()))


def test_a_micromodem_receives_and_sends_frames(config, start_s, tmp_path):
    pytest.importorskip("acomms", reason="the package acomms is absent")
    from micromodem import Bridge

    theirs = frame_of(config, "auv2", start_s)
    path, record, modem = config("auv1"), Record(), SimulatedModem()
    bridge = Bridge(modem.port, path, log_folder=tmp_path, on_message=record)
    assert {"CCCFQ,SRC", "CCCFG,SRC,1", "CCCFG,CST,1", "CCCFG,RXP,1", "CCCFG,REV,1"} <= set(modem.commands)
    feed_navigation(bridge.pingmap)
    threading.Thread(target=bridge.send_frames, daemon=True).start()

    # A frame of another vehicle arrives in its slot, and its slot counts as heard.
    begin_s = next_slot(start_s, 1)
    wait_until(begin_s + 0.2)
    modem.receive(2, theirs)
    wanted = lambda request, answer: answer["type"] == "acknowledgement" and request["bytes"] == theirs
    assert record.wait_for(wanted)["counts"]
    is_its_slot = lambda _, answer: answer["type"] == "event" and answer["from"] == "auv2" and answer["time"] == begin_s
    assert record.wait_for(is_its_slot)["heard"]

    # A frame of this vehicle leaves in its slot, unchanged.
    sent = modem.sent.get(timeout=60)
    frame = record.wait_for(lambda _, answer: answer["type"] == "frame")
    assert sent.lower() == frame["bytes"].lower()
    departed = {"type": "departed", "token": frame["token"]}
    record.wait_for(lambda request, answer: answer["type"] == "ok" and departed.items() <= request.items())

    # A frame that the modem refuses is dropped.
    modem.is_failing = True
    record.wait_for(lambda request, answer: answer["type"] == "ok" and request["type"] == "dropped", timeout_s=60)
    assert not record.errors()
    status = bridge.pingmap.call({"type": "status"})
    assert status["frames"]["accepted"] == 1
    bridge.pingmap.stop()


def feed_navigation(pingmap):
    """Reports a position every 0.3 s from now on, as the navigation of a host does."""

    def feed():
        while pingmap.process.poll() is None:
            try:
                pingmap.send({"type": "nav", "time": time.time(), "position": {"x": 700, "y": 600}})
            except (BrokenPipeError, ValueError):
                return
            time.sleep(0.3)

    threading.Thread(target=feed, daemon=True).start()


def next_slot(start_s, place):
    """Returns the begin of the next slot of a member in the future."""
    cycle = int((time.time() - start_s) / (3 * SLOT_S)) + 1
    return start_s + (3 * cycle + place) * SLOT_S


def test_ros_2_nodes_exchange_positions_and_messages(config, start_s):
    pytest.importorskip("cyclonedds", reason="the package cyclonedds is absent")
    import ros2_types as ros
    from cyclonedds.domain import DomainParticipant
    from cyclonedds.pub import DataWriter
    from cyclonedds.sub import DataReader
    from cyclonedds.topic import Topic
    from ros2_dds import RELIABLE, Bridge

    record, domain = Record(), 71
    bridge = Bridge(config("auv1"), domain)
    publish = bridge.pingmap.on_message
    bridge.pingmap.on_message = lambda request, answer: (record(request, answer), publish(request, answer))
    node = DomainParticipant(domain)
    answers = DataReader(node, Topic(node, "rt/pingmap/out", ros.String), RELIABLE)
    lines, fixes, odometry = (
        DataWriter(node, Topic(node, name, kind), RELIABLE)
        for name, kind in (("rt/pingmap/in", ros.String), ("rt/fix", ros.NavSatFix), ("rt/odom", ros.Odometry))
    )
    time.sleep(1)  # The participants discover each other.

    def header(time_s):
        return ros.Header(ros.Time(int(time_s), int(time_s % 1 * 1e9)), "map")

    status, covariance = ros.NavSatStatus(0, 1), [4.0, 0, 0, 0, 9.0, 0, 0, 0, 0]
    fixes.write(ros.NavSatFix(header(start_s), status, 54.005, 10.01, 0.0, covariance, 2))
    fix = record.wait_for(lambda request, answer: request.get("position", {}).get("lat"))
    assert fix["type"] == "ok"
    pose = ros.Pose(ros.Point(700.0, 600.0, -12.0), ros.Quaternion(0.0, 0.0, 0.0, 1.0))
    twist = ros.TwistWithCovariance(ros.Twist(ros.Vector(0.0, 0.0, 0.0), ros.Vector(0.0, 0.0, 0.0)), [0.0] * 36)
    for second in range(2, 12):
        place = ros.PoseWithCovariance(pose, [0.0] * 36)
        odometry.write(ros.Odometry(header(start_s + second), "base_link", place, twist))
    record.wait_for(lambda request, answer: request.get("time") == start_s + 11)
    request = next(request for request, _ in record.all if request.get("time") == start_s + 11)
    assert request["position"] == {"x": 700, "y": 600, "depth": 12, "heading": 90}
    positions = {request["time"]: request for request, _ in record.all if request.get("type") == "nav"}
    assert positions[start_s]["sigma"] == 3 and positions[start_s]["surfaced"]
    assert positions[start_s + 2]["surfaced"] and not positions[start_s + 11]["surfaced"]

    link = {"from": "auv1", "to": {"x": 900, "y": 600}}
    lines.write(ros.String(json.dumps({"type": "predict", "links": [link]})))
    received, deadline = [], time.time() + 20
    while time.time() < deadline and not any(answer["type"] == "prediction" for answer in received):
        received += [json.loads(sample.data) for sample in answers.take(100)]
        time.sleep(0.05)
    prediction = next(answer for answer in received if answer["type"] == "prediction")
    assert prediction["request"]["links"] == [link] and 0 < prediction["links"][0]["probability"] < 1
    assert not record.errors()
    bridge.pingmap.stop()


class StandInMail:
    """Has the methods of `pymoos.moos_msg` that the bridge uses."""

    def __init__(self, name, value, time_s):
        self.name, self.time = (lambda: name), (lambda: time_s)
        self.double, self.string = (lambda: value), (lambda: value)


class StandInComms:
    """Stands in for `pymoos.comms`: no MOOSDB can be installed from a registry. The test delivers the mail itself."""

    def __init__(self):
        self.registered, self.published, self.mail = [], [], []

    def set_on_connect_callback(self, function):
        self.connect = function

    def set_on_mail_callback(self, function):
        self.deliver = function

    def register(self, name, interval):
        self.registered.append(name)
        return True

    def notify(self, name, value, time_s):
        self.published.append((name, json.loads(value)))
        return True

    def fetch(self):
        mail, self.mail = self.mail, []
        return mail


def test_moos_mail_becomes_messages_with_a_stand_in_for_the_client(config, start_s):
    pymoos = pytest.importorskip("pymoos", reason="the package pymoos is absent: it has wheels up to Python 3.10")
    from moos import VARIABLES, Bridge

    comms = StandInComms()
    used = [name for name in vars(StandInComms) if not name.startswith("_")]
    assert all(hasattr(pymoos.comms, name) for name in used)
    assert all(hasattr(pymoos.moos_msg, name) for name in vars(StandInMail("", 0, 0)))
    bridge, record = Bridge(config("auv1"), comms), Record()
    publish = bridge.pingmap.on_message
    bridge.pingmap.on_message = lambda request, answer: (record(request, answer), publish(request, answer))
    assert comms.connect() and set(comms.registered) == set(VARIABLES)

    def mail(*items):
        comms.mail += [StandInMail(*item) for item in items]
        assert comms.deliver()

    for second in range(12):
        time_s = start_s + second
        place = {"NAV_X": 700.0, "NAV_Y": 600.0 + second, "NAV_DEPTH": 5.0, "NAV_HEADING": 90.0}
        mail(*((name, value, time_s) for name, value in place.items()))
        text = f"NAME=auv2,X=900,Y=650,DEP=4,SPD=1,HDG=0,TIME={time_s}"
        mail(("NODE_REPORT", text, time_s + 0.01), ("NODE_REPORT", text.replace("auv2", "auv1"), time_s + 0.02))
    mail(("ACOMMS_NMEA_IN", "$CAREV,120030,AUV,0.92.0.85", start_s + 12))
    mail(("PINGMAP_IN", json.dumps({"type": "predict", "links": [{"from": "auv1", "to": "auv2"}]}), start_s + 12))
    record.wait_for(lambda request, answer: answer["type"] == "prediction")
    sent = [request for request, _ in record.all if request]
    last = [request for request in sent if request["type"] == "nav"][-1]
    assert last["time"] == start_s + 10
    assert last["position"] == {"x": 700, "y": 610, "depth": 5, "heading": 90}
    peers = [request for request in sent if request["type"] == "peer"]
    assert {peer["member"] for peer in peers} == {"auv2"} and peers[0]["source"] == "message"
    assert any(request["type"] == "nmea" for request in sent)
    deadline = time.time() + 10
    while time.time() < deadline and not any(answer["type"] == "prediction" for _, answer in comms.published):
        time.sleep(0.02)
    name, prediction = next(pair for pair in comms.published if pair[1]["type"] == "prediction")
    assert name == "PINGMAP_OUT" and 0 < prediction["links"][0]["probability"] < 1
    assert not record.errors()
    bridge.pingmap.stop()
