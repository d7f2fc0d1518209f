"""A `pingmap vehicle` process as a Python object. The bridges in this folder share it."""

import json
import os
import queue
import subprocess
import threading

# Every line has one closing answer. An acknowledgement closes only these messages.
CLOSED_BY_ACKNOWLEDGEMENT = {"frame_in", "piggyback_in"}


class Pingmap:
    """Starts the process and greets it. `on_message(request, answer)` runs in the reader's thread for every answer."""

    def __init__(self, config, on_message=None):
        program = [os.environ.get("PINGMAP", "pingmap"), "vehicle", "--config", str(config)]
        self.process = subprocess.Popen(program, stdin=subprocess.PIPE, stdout=subprocess.PIPE)
        self.on_message, self.lock, self.lines, self.open = on_message, threading.Lock(), 0, {}
        self.reader = threading.Thread(target=self._read, daemon=True)
        self.reader.start()
        self.hello = self.call({"type": "hello", "version": 1})
        if self.hello["type"] != "hello":
            raise RuntimeError(f"pingmap refused the greeting: {self.hello}")

    def send(self, message):
        """Writes one line. Returns a queue that receives its closing answer."""
        with self.lock:
            self.lines += 1
            answer = queue.Queue()
            self.open[1 if message["type"] == "hello" else self.lines] = message, answer
            self.process.stdin.write(json.dumps(message).encode() + b"\n")
            self.process.stdin.flush()
        return answer

    def send_line(self, line):
        """Writes a line from outside. A line that is no message gets an error, and the bridge continues."""
        try:
            message = json.loads(line)
            if not isinstance(message.get("type"), str):
                raise ValueError('no "type"')
        except (ValueError, AttributeError) as error:
            if self.on_message:
                self.on_message(line, {"type": "error", "code": "not_json", "message": f"not a message: {error}"})
        else:
            self.send(message)

    def call(self, message, timeout_s=60):
        """Writes one line and waits for its closing answer."""
        return self.send(message).get(timeout=timeout_s)

    def _read(self):
        for line in self.process.stdout:
            answer = json.loads(line)
            kind = answer["type"]
            number = {"hello": 1, "stopped": self.lines}.get(kind, answer.get("input"))
            request, waiting = self.open.get(number, (None, None))
            if waiting and (kind != "acknowledgement" or request["type"] in CLOSED_BY_ACKNOWLEDGEMENT):
                del self.open[number]
                waiting.put(answer)
            if self.on_message:
                self.on_message(request, answer)
        for _, waiting in self.open.values():
            waiting.put({"type": "error", "code": "ended", "message": "the process has ended"})

    def stop(self):
        """Ends the process. Everything is stored when this returns."""
        stopped = self.call({"type": "stop"})
        self.process.stdin.close()
        self.process.wait(timeout=60)
        self.reader.join()
        return stopped
