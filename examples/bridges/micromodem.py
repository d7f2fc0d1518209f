"""Runs pingmap with a WHOI Micro-Modem: micromodem.py [--listen-only] PORT vehicle.toml

Standard input takes further messages for pingmap, such as `nav`. Standard output has all answers.
"""

import json
import logging
import math
import sys
import threading
import time

from acomms.micromodem import Micromodem
from acomms.unifiedlog import UnifiedLog
from configuration import modem_ids, own_slots
from pingmap_process import Pingmap

BROADCAST, RATE, FRAME_BYTES = 15, 0, 32


class Bridge(logging.Handler):
    """Passes every sentence to pingmap, and sends its frames. The log of `acomms` has all sentences in their order."""

    def __init__(self, port, config, log_folder=".", on_message=None):
        super().__init__()
        (self.ids, self.own), self.slots = modem_ids(config), own_slots(config)
        self.frame, self.is_loaded, self.begin_s = None, False, None
        self.pingmap = Pingmap(config, on_message)
        log = UnifiedLog(log_path=log_folder, rootname="micromodem", custom_handler=self)
        self.modem = Micromodem(name="modem", unified_log=log)
        self.modem.connect_serial(port, 19200)
        for setting in (("SRC", self.own), ("CST", 1), ("RXP", 1), ("REV", 1)):
            self.modem.set_config(*setting)

    def emit(self, record):
        if ".nmea." not in record.name:
            return
        now_s, sentence = record.created, record.getMessage()
        self.pingmap.send({"type": "nmea", "time": now_s, "sentence": sentence})
        name, *fields = sentence.lstrip("$").split("*")[0].split(",")
        if name == "CARXD" and fields[0] in self.ids and fields[4]:
            self.pingmap.send({"type": "frame_in", "time": now_s, "from": self.ids[fields[0]], "bytes": fields[4]})
        elif name == "CADRQ" and self.frame:
            self.modem.write_nmea(f"$CCTXD,{self.own},{BROADCAST},0,{self.frame['bytes']}")
        elif name == "CCTXD":
            self.is_loaded = True
        elif name == "CATXP" and self.is_loaded:
            self.begin_s = now_s
        elif name == "CATXF" and self.begin_s:
            self.close_frame("departed", time=self.begin_s)
        elif (name == "CAERR" and not self.begin_s) or name == "CAXST" and fields[3 if len(fields[0]) == 8 else 4] != "0":
            self.close_frame("dropped")

    def close_frame(self, kind, **fields):
        if self.frame:
            self.pingmap.send({"type": kind, "token": self.frame["token"], **fields})
        self.frame, self.is_loaded, self.begin_s = None, False, None

    def send_frames(self):
        """Sends a frame in every own slot, if pingmap has one. A frame stays open if its fate is unknown."""
        begin_s, period_s, duration_s = self.slots
        while True:
            slot_s = begin_s + math.ceil((time.time() - begin_s) / period_s) * period_s
            time.sleep(max(0, slot_s - time.time()))
            answer = self.pingmap.call({"type": "frame_request", "time": slot_s, "bytes": FRAME_BYTES})
            if answer["type"] == "frame":
                self.frame, self.is_loaded, self.begin_s = answer, False, None
                self.modem.write_nmea(f"$CCCYC,0,{self.own},{BROADCAST},{RATE},0,1")
                time.sleep(duration_s / 2)
                if self.frame == answer and not self.is_loaded:
                    self.close_frame("dropped")


if __name__ == "__main__":
    bridge = Bridge(*sys.argv[-2:], on_message=lambda _, answer: print(json.dumps(answer), flush=True))
    if "--listen-only" not in sys.argv:
        threading.Thread(target=bridge.send_frames, daemon=True).start()
    for line in sys.stdin:
        bridge.pingmap.send_line(line)
    bridge.pingmap.stop()
