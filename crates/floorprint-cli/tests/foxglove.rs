//! What Foxglove sees of a live session.
//!
//! The viewer of the first tests is Foxglove's own client from npm, installed below the target folder and run by `node`; where
//! there is none of them that is said, and nothing is tested. The others speak the protocol by hand.

#![cfg(feature = "foxglove")]
#![expect(clippy::unwrap_used, reason = "a test ends where a step fails")]

use serde_json::Value;
use std::fs;
use std::io::{BufRead as _, BufReader, Write as _};
use std::net::TcpStream;
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStdin, Command, Stdio};
use std::thread::sleep;
use std::time::{Duration, Instant};
use tungstenite::client::IntoClientRequest as _;
use tungstenite::{Message, WebSocket};

/// A session that is fed by the test, with a server for Foxglove.
struct Shown {
    child: Child,
    input: Option<ChildStdin>,
    address: String,
}

impl Shown {
    fn start(arguments: &[&str]) -> Self {
        let mut child = Command::new(env!("CARGO_BIN_EXE_floorprint"))
            .args(["live", "-", "--foxglove", "127.0.0.1:0"])
            .args(arguments)
            .stdin(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()
            .unwrap();
        let mut said = BufReader::new(child.stderr.take().unwrap());
        let mut line = String::new();
        while !line.contains("ws://") {
            line.clear();
            assert!(said.read_line(&mut line).unwrap() > 0, "no server");
        }
        // Nobody reads the rest, and it is not waited for.
        std::thread::spawn(move || said.lines().for_each(drop));
        let address = line.split("ws://").nth(1).unwrap().trim().split('/').next().unwrap().to_owned();
        let input = child.stdin.take();
        Self { child, input, address }
    }

    /// Scans of a drive through a room, from one to another, each after so long.
    fn drive(&mut self, scans: std::ops::Range<usize>, pause: Duration) {
        let input = self.input.as_mut().unwrap();
        for scan in scans {
            let (stamp, x) = (100.0 + 0.1 * scan as f64, 0.02 * scan as f64);
            // A room of 7 m by 4.5 m.
            let range = |ray: usize| {
                let (sin, cos) = (-1.5 + 0.0167 * ray as f64).sin_cos();
                let to_end = if cos > 0.0 { (5.0 - x) / cos } else { (-2.0 - x) / cos };
                to_end.min(if sin > 0.0 { 2.0 / sin } else { -2.5 / sin })
            };
            let ranges: Vec<String> = (0..180).map(|ray| format!("{:.3}", range(ray))).collect();
            let lines = format!(
                "{{\"type\":\"odometry\",\"stamp\":{stamp},\"x\":{x},\"y\":0,\"theta\":0}}\n\
                 {{\"type\":\"scan\",\"stamp\":{stamp},\"angle_min\":-1.5,\"angle_increment\":0.0167,\"ranges\":[{}]}}\n",
                ranges.join(",")
            );
            input.write_all(lines.as_bytes()).unwrap();
            sleep(pause);
        }
    }

    /// A viewer that speaks the protocol by hand.
    fn connect(&self) -> WebSocket<TcpStream> {
        let mut request = format!("ws://{}/", self.address).into_client_request().unwrap();
        request.headers_mut().insert("sec-websocket-protocol", "foxglove.sdk.v1".parse().unwrap());
        let stream = TcpStream::connect(&self.address).unwrap();
        stream.set_read_timeout(Some(Duration::from_secs(10))).unwrap();
        tungstenite::client(request, stream).unwrap().0
    }

    /// Kilobytes of memory that the session holds.
    #[cfg(target_os = "linux")]
    fn memory_kb(&self) -> u64 {
        let status = fs::read_to_string(format!("/proc/{}/status", self.child.id())).unwrap();
        let line = status.lines().find_map(|line| line.strip_prefix("VmRSS:")).unwrap();
        line.split_whitespace().next().unwrap().parse().unwrap()
    }
}

impl Drop for Shown {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// The folder in which Foxglove's client is, if it can be there; else why it cannot.
fn client() -> Result<PathBuf, String> {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join("foxglove");
    let sources = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/foxglove");
    let is_there =
        |program: &str| Command::new(program).arg("--version").output().is_ok_and(|out| out.status.success());
    if !is_there("node") || !is_there("npm") {
        return Err("there is no node with npm".to_owned());
    }
    // Tests run side by side.
    static INSTALLED: std::sync::Mutex<()> = std::sync::Mutex::new(());
    let _alone = INSTALLED.lock().unwrap();
    fs::create_dir_all(&folder).unwrap();
    fs::copy(sources.join("viewer.mjs"), folder.join("viewer.mjs")).unwrap();
    let wanted = fs::read(sources.join("package.json")).unwrap();
    if fs::read(folder.join("installed.json")).is_ok_and(|found| found == wanted) {
        return Ok(folder);
    }
    fs::write(folder.join("package.json"), &wanted).unwrap();
    let arguments = ["install", "--no-audit", "--no-fund", "--ignore-scripts", "--fetch-retries=1"];
    let install = Command::new("npm").args(arguments).current_dir(&folder).output().unwrap();
    if !install.status.success() {
        let said = String::from_utf8_lossy(&install.stderr).into_owned();
        let unreachable = ["ENOTFOUND", "ECONN", "EAI_AGAIN", "ETIMEDOUT", "network"];
        assert!(unreachable.iter().any(|sign| said.contains(sign)), "{said}");
        return Err(format!("npm's registry cannot be reached: {}", said.lines().next().unwrap_or_default()));
    }
    fs::write(folder.join("installed.json"), wanted).unwrap();
    Ok(folder)
}

/// Starts Foxglove's client.
fn watch(folder: &Path, shown: &Shown, arguments: &[&str]) -> Child {
    let address = format!("ws://{}", shown.address);
    let mut node = Command::new("node");
    node.arg("viewer.mjs").arg(address).args(arguments).current_dir(folder);
    node.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap()
}

/// What it found.
fn found(viewer: Child) -> Value {
    let output = viewer.wait_with_output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    serde_json::from_slice(&output.stdout).unwrap()
}

#[test]
fn foxgloves_client_receives_and_decodes_every_channel() {
    let folder = match client() {
        Ok(folder) => folder,
        Err(reason) => return eprintln!("SKIPPED: no viewer: {reason}"),
    };
    let out = tempfile::tempdir().unwrap();
    let mut shown = Shown::start(&["--out", out.path().join("out").to_str().unwrap()]);
    let viewer = watch(&folder, &shown, &["foxglove.websocket.v1", "4"]);
    shown.drive(0..60, Duration::from_millis(50));
    let seen = found(viewer);
    assert_eq!((&seen["errors"], &seen["statuses"]), (&Value::Array(vec![]), &Value::Array(vec![])), "{seen}");
    let newest = |topic: &str| &seen["channels"][topic]["newest"];
    for (topic, least) in [
        ("/map", 1),
        ("/scene", 1),
        ("/tf", 20),
        ("/pose", 20),
        ("/scan", 20),
        ("/hypotheses", 20),
        ("/diagnostics", 1),
    ] {
        let count = seen["channels"][topic]["count"].as_u64().unwrap();
        assert!(count >= least, "{topic}: {count}: {seen}");
    }
    let number = |value: &Value| value.as_f64().unwrap();
    let map = newest("/map");
    assert!(map["frame"] == "map" && map["fields"] == serde_json::json!(["red", "green", "blue", "alpha"]), "{map}");
    assert!((number(&map["cell"]) - 0.05).abs() < 1e-9 && number(&map["occupied"]) > 50.0, "{map}");
    assert!((number(&map["rows"]) * number(&map["columns"]) * 4.0 - number(&map["bytes"])).abs() < 0.5, "{map}");
    let x = number(&newest("/pose")["x"]);
    assert!((x - 1.18).abs() < 0.1 && number(&newest("/pose")["variance"]) > 0.0, "{}", newest("/pose"));
    assert_eq!(newest("/tf")["tree"], serde_json::json!(["map>odom", "odom>base_link", "base_link>laser"]));
    let along: f64 = (0..2).map(|at| number(&newest("/tf")["x"][at])).sum();
    assert!((along - x).abs() < 0.1, "{along}, {x}");
    let scan = newest("/scan");
    assert!(scan["points"] == 180 && scan["frame"] == "base_link", "{scan}");
    let scene = newest("/scene");
    assert!(scene["entities"][0][0] == "trajectory" && number(&scene["last"]["x"]) > 0.1, "{scene}");
    assert!((number(&seen["channels"]["/scan"]["timestamp"]) - 105.0).abs() < 1.5, "{seen}");

    // Who comes late, while nothing moves, gets all of it at once; in the newer protocol, too.
    let late = found(watch(&folder, &shown, &["foxglove.sdk.v1", "2"]));
    for topic in ["/map", "/scene", "/tf", "/pose", "/scan"] {
        let first_ms = number(&late["channels"][topic]["firstMs"]);
        assert!(first_ms < 1500.0, "{topic} after {first_ms} ms");
    }
}

#[test]
fn in_a_finished_map_foxglove_says_where_the_robot_is() {
    let folder = match client() {
        Ok(folder) => folder,
        Err(reason) => return eprintln!("SKIPPED: no viewer: {reason}"),
    };
    let files = tempfile::tempdir().unwrap();
    let session = files.path().join("site.gpkg").display().to_string();
    let mut mapping = Shown::start(&["--session", &session]);
    mapping.drive(0..60, Duration::ZERO);
    mapping.input = None;
    assert!(mapping.child.wait().unwrap().success());
    let mut shown = Shown::start(&["--map", &session, "--pose", "1.5,0,0"]);
    let viewer = watch(&folder, &shown, &["foxglove.websocket.v1", "4", "0.02", "0"]);
    sleep(Duration::from_millis(1500));
    shown.drive(1..40, Duration::from_millis(30));
    let seen = found(viewer);
    assert_eq!(seen["info"]["capabilities"], serde_json::json!(["clientPublish"]));
    assert_eq!((&seen["errors"], &seen["statuses"]), (&Value::Array(vec![]), &Value::Array(vec![])), "{seen}");
    let x = seen["channels"]["/pose"]["newest"]["x"].as_f64().unwrap();
    assert!((x - 0.78).abs() < 0.15, "{x}: {seen}");
}

/// Reads until a message of JSON with this `op` comes.
fn until(socket: &mut WebSocket<TcpStream>, op: &str) -> Value {
    loop {
        if let Message::Text(text) = socket.read().unwrap() {
            let said: Value = serde_json::from_str(&text).unwrap();
            if said["op"] == op {
                return said;
            }
        }
    }
}

#[test]
fn requests_that_cannot_be_met_are_answered() {
    let out = tempfile::tempdir().unwrap();
    let shown = Shown::start(&["--out", out.path().join("out").to_str().unwrap()]);
    let mut socket = shown.connect();
    assert_eq!(until(&mut socket, "serverInfo")["capabilities"], serde_json::json!([]));
    assert_eq!(until(&mut socket, "advertise")["channels"].as_array().unwrap().len(), 7);
    for (request, answer) in [
        (r#"{"op":"subscribe","subscriptions":[{"id":1,"channelId":99}]}"#, "no channel 99"),
        (r#"{"op":"subscribe","subscriptions":[{"id":1,"channelId":1},{"id":1,"channelId":2}]}"#, "not taken"),
        (r#"{"op":"getParameters","parameterNames":[],"id":"x"}"#, "not offered"),
        (r#"{"op":"subscribe"}"#, "not understood"),
        ("nonsense", "not understood"),
        (
            r#"{"op":"advertise","channels":[{"id":1,"topic":"/cmd_vel","encoding":"cdr","schemaName":"x"}]}"#,
            "nothing is taken",
        ),
    ] {
        socket.send(Message::text(request)).unwrap();
        let said = until(&mut socket, "status");
        assert!(said["message"].as_str().unwrap().contains(answer), "{request}: {said}");
    }
    // What is no viewer is told so.
    let refused = |headers: &[(&'static str, &'static str)]| {
        let mut request = format!("ws://{}/", shown.address).into_client_request().unwrap();
        for &(name, value) in headers {
            request.headers_mut().insert(name, value.parse().unwrap());
        }
        let stream = TcpStream::connect(&shown.address).unwrap();
        match tungstenite::client(request, stream) {
            Err(tungstenite::HandshakeError::Failure(tungstenite::Error::Http(answer))) => answer.status().as_u16(),
            other => panic!("{other:?}"),
        }
    };
    let spoken = ("sec-websocket-protocol", "foxglove.sdk.v1");
    assert_eq!(refused(&[]), 400);
    assert_eq!(refused(&[spoken, ("origin", "https://evil.example")]), 403);
    assert_eq!(refused(&[spoken, ("host", "evil.example")]), 421);
}

#[cfg(target_os = "linux")]
#[test]
fn floods_of_garbage_take_no_memory_and_honest_viewers_are_served() {
    let out = tempfile::tempdir().unwrap();
    let mut shown = Shown::start(&["--out", out.path().join("out").to_str().unwrap()]);
    shown.drive(0..20, Duration::ZERO);
    let before_kb = shown.memory_kb();
    let garbage: Vec<u8> = (0..1 << 16).map(|at: u32| (at.wrapping_mul(2_654_435_761) >> 24) as u8).collect();
    let mut flood = Vec::new();
    for number in 0..200 {
        let stream = TcpStream::connect(&shown.address).unwrap();
        stream.set_write_timeout(Some(Duration::from_millis(200))).unwrap();
        let mut stream = stream;
        match number % 5 {
            0 => {}
            1 => _ = stream.write_all(&garbage),
            2 => _ = stream.write_all(b"GET / HTTP/1.1\r\nHost: localhost\r\nX: "),
            // Through the door, and then nonsense, or a frame that announces more than anybody may say.
            3 => {
                let mut socket = shown.connect();
                let _ = socket.get_mut().write_all(&garbage);
                flood.push(socket.get_mut().try_clone().unwrap());
            }
            _ => {
                let mut socket = shown.connect();
                let _ = socket.get_mut().write_all(&[0x82, 0xff, 0, 0, 0, 0x7f, 0xff, 0xff, 0xff, 0xff, 1, 2, 3, 4]);
                let _ = socket.get_mut().write_all(&garbage);
            }
        }
        flood.push(stream);
    }
    // One that asks without end is sent away.
    let mut greedy = shown.connect();
    greedy.get_mut().set_write_timeout(Some(Duration::from_secs(5))).unwrap();
    let is_sent_away = (0..100_000).any(|_| greedy.send(Message::text("[]")).is_err());
    assert!(is_sent_away);

    let asked = Instant::now();
    let mut honest = shown.connect();
    honest.send(Message::text(r#"{"op":"subscribe","subscriptions":[{"id":5,"channelId":4}]}"#)).unwrap();
    let served = loop {
        if let Message::Binary(bytes) = honest.read().unwrap() {
            break bytes;
        }
    };
    assert_eq!(served[..5], [1, 5, 0, 0, 0]);
    assert!(asked.elapsed() < Duration::from_secs(5), "{:?}", asked.elapsed());
    let grown_kb = shown.memory_kb().saturating_sub(before_kb);
    assert!(grown_kb < 40_000, "{grown_kb} kB more");
    // The session went on.
    drop(flood);
    shown.drive(20..30, Duration::ZERO);
    shown.input = None;
    assert!(shown.child.wait().unwrap().success());
    assert!(out.path().join("out/map.pgm").exists());
}
