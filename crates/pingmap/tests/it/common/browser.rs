//! Chromium, controlled by the messages of its developer tools.

use std::fs::File;
use std::io::{BufRead, BufReader, Write};
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use serde_json::{Value, json};

use super::chromium::{HEADLESS, chromium};

/// Starts Chromium with pipes as the files 3 and 4, which it reads requests from and writes answers to.
const START: &str =
    "mkfifo in out && exec $0 \"$@\" --user-data-dir=profile --remote-debugging-pipe about:blank 3< in 4> out";

/// A running Chromium with one page. It ends with this value.
pub struct Browser {
    process: Child,
    requests: File,
    answers: BufReader<File>,
    /// Identifies the page in requests.
    session: Value,
    requested: u64,
    /// Messages without a request: errors, entries of the console, and files that the page loads.
    events: Vec<Value>,
}

impl Browser {
    /// Starts Chromium, or prints that the test is skipped. Files of the browser are written to the folder.
    pub fn start(folder: &Path) -> Option<Self> {
        let program = chromium()?;
        let mut shell = Command::new("sh");
        let process = shell
            .args(["-c", START, program])
            .args(HEADLESS)
            .current_dir(folder)
            .stderr(Stdio::null())
            .spawn()
            .unwrap();
        let start = Instant::now();
        while !folder.join("out").exists() {
            assert!(start.elapsed() < Duration::from_secs(30), "the shell makes no pipes");
            std::thread::sleep(Duration::from_millis(10));
        }
        // Each call waits until the shell opens the other end.
        let requests = File::options().write(true).open(folder.join("in")).unwrap();
        let answers = BufReader::new(File::open(folder.join("out")).unwrap());
        let mut browser = Self { process, requests, answers, session: Value::Null, requested: 0, events: Vec::new() };
        let target = browser.call("Target.createTarget", json!({"url": "about:blank"}))["targetId"].clone();
        let attached = browser.call("Target.attachToTarget", json!({"targetId": target, "flatten": true}));
        browser.session = attached["sessionId"].clone();
        for domain in ["Page", "Runtime", "Log", "Network"] {
            browser.call(&format!("{domain}.enable"), json!({}));
        }
        Some(browser)
    }

    /// Sends a request, and returns its result.
    pub fn call(&mut self, method: &str, parameters: Value) -> Value {
        self.requested += 1;
        let mut request = json!({"id": self.requested, "method": method, "params": parameters});
        if !self.session.is_null() {
            request["sessionId"] = self.session.clone();
        }
        self.requests.write_all(format!("{request}\0").as_bytes()).unwrap();
        loop {
            let mut bytes = Vec::new();
            self.answers.read_until(0, &mut bytes).unwrap();
            assert_eq!(bytes.pop(), Some(0), "Chromium ended");
            let message: Value = serde_json::from_slice(&bytes).unwrap();
            if message["id"] == self.requested {
                assert!(message["error"].is_null(), "{method}: {message}");
                return message["result"].clone();
            }
            self.events.push(message);
        }
    }

    /// Opens a file, and waits until it is loaded.
    pub fn open(&mut self, path: &Path) {
        self.call("Page.navigate", json!({"url": format!("file://{}", path.display())}));
        self.wait_until("document.readyState === 'complete' && location.protocol === 'file:'");
    }

    /// Evaluates an expression in the page.
    pub fn value(&mut self, expression: &str) -> Value {
        let evaluated = self.call("Runtime.evaluate", json!({"expression": expression, "returnByValue": true}));
        assert!(evaluated["exceptionDetails"].is_null(), "{expression}: {evaluated}");
        evaluated["result"]["value"].clone()
    }

    /// Evaluates an expression to a text.
    pub fn text(&mut self, expression: &str) -> String {
        self.value(expression).as_str().unwrap_or_else(|| panic!("{expression} is no text")).to_owned()
    }

    /// Waits until an expression is true.
    pub fn wait_until(&mut self, expression: &str) {
        let start = Instant::now();
        while self.value(expression) != Value::Bool(true) {
            assert!(start.elapsed() < Duration::from_secs(30), "never: {expression}");
            std::thread::sleep(Duration::from_millis(50));
        }
    }

    /// Presses and releases a key, by its name and its code on Windows.
    pub fn press(&mut self, key: &str, code: u32) {
        let text = if key == " " { key } else { "" };
        for kind in ["keyDown", "keyUp"] {
            let parameters = json!({"type": kind, "key": key, "windowsVirtualKeyCode": code, "text": text});
            self.call("Input.dispatchKeyEvent", parameters);
        }
    }

    /// Touches the page at a position in pixels.
    pub fn touch(&mut self, x: f64, y: f64) {
        self.call("Input.dispatchTouchEvent", json!({"type": "touchStart", "touchPoints": [{"x": x, "y": y}]}));
        self.call("Input.dispatchTouchEvent", json!({"type": "touchEnd", "touchPoints": []}));
    }

    /// Sets features of the reader's device, such as `prefers-color-scheme`.
    pub fn emulate(&mut self, features: &[(&str, &str)]) {
        let features: Vec<Value> = features.iter().map(|(name, value)| json!({"name": name, "value": value})).collect();
        self.call("Emulation.setEmulatedMedia", json!({"features": features}));
    }

    /// Sets the width and height of the window in pixels of the page.
    pub fn resize(&mut self, width: u32, height: u32) {
        let size = json!({"width": width, "height": height, "deviceScaleFactor": 1, "mobile": false});
        self.call("Emulation.setDeviceMetricsOverride", size);
    }

    /// Returns errors of scripts and entries of the console.
    pub fn problems(&self) -> Vec<&Value> {
        let methods = ["Runtime.exceptionThrown", "Runtime.consoleAPICalled", "Log.entryAdded"];
        self.events.iter().filter(|event| methods.iter().any(|method| event["method"] == *method)).collect()
    }

    /// Returns the addresses of everything that pages loaded.
    pub fn loaded(&self) -> Vec<&str> {
        let requests = self.events.iter().filter(|event| event["method"] == "Network.requestWillBeSent");
        requests.filter_map(|event| event["params"]["request"]["url"].as_str()).collect()
    }
}

impl Drop for Browser {
    fn drop(&mut self) {
        // The browser may have ended by itself.
        let _ = self.process.kill();
        let _ = self.process.wait();
    }
}
