//! Live sessions as users have them: recordings played, lines piped in, sessions killed and gone on with.

#![expect(clippy::unwrap_used, reason = "a test ends where a step fails")]

use std::fs;
use std::io::{BufRead as _, BufReader, Read as _, Write as _};
use std::net::TcpStream;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Output, Stdio};
use std::sync::OnceLock;
use std::thread::sleep;
use std::time::{Duration, Instant};
use tempfile::TempDir;

/// A short drive with encoders, IMU and a LiDAR, and what `run` makes of it; made once.
fn shared() -> &'static Path {
    static SHARED: OnceLock<TempDir> = OnceLock::new();
    SHARED
        .get_or_init(|| {
            let folder = tempfile::tempdir().unwrap();
            let at = |name: &str| folder.path().join(name).display().to_string();
            let robot = "[motion]\nspeed_m_s = 2.0\n[lidar]\nbeams = 181\nrate_hz = 10.0\n[camera]\nrate_hz = 0.0\n";
            fs::write(at("robot.toml"), robot).unwrap();
            let options = ["simulate", "--world", "rooms", "--seed", "1", "--config", &at("robot.toml")];
            floorprint(&[&options[..], &["--out", &at("drive")]].concat(), 0);
            floorprint(&["run", &at("drive"), "--out", &at("run")], 0);
            folder
        })
        .path()
}

fn at(name: &str) -> String {
    shared().join(name).display().to_string()
}

fn command(arguments: &[&str]) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_floorprint"));
    command.args(arguments).stdin(Stdio::null());
    command
}

/// Runs a command that must end with a code; gives what it says.
fn floorprint(arguments: &[&str], code: i32) -> String {
    let Output { status, stderr, stdout } = command(arguments).output().unwrap();
    let said = String::from_utf8_lossy(&stderr).into_owned() + &String::from_utf8_lossy(&stdout);
    assert_eq!(status.code(), Some(code), "{arguments:?}: {said}");
    assert!(!said.contains("panicked"), "{said}");
    said
}

/// Whether two folders hold the same trajectory and map, to the byte.
fn assert_same(one: &Path, other: &Path) {
    for name in ["trajectory.tum", "map.pgm", "map.yaml"] {
        let [one, other] = [one, other].map(|folder| fs::read(folder.join(name)).unwrap());
        assert!(one == other, "{name} differs");
        assert!(one.len() > 60, "{name} is empty");
    }
}

/// The log of a robot whose stamps and angles are no numbers of ROS, as CARMEN has them.
fn carmen_log(folder: &Path) -> PathBuf {
    let line = |scan: i32| {
        let x = 0.013 * f64::from(scan);
        let wall =
            |ray: i32| (2.0 + 0.3 * f64::from((ray / 20) % 3)) / (f64::from(ray) / 57.3).sin().abs().max(0.4) - 0.1 * x;
        let ranges: String = (0..181).map(|ray| format!("{:.3} ", wall(ray))).collect();
        let stamp_s = 976_052_857.301_234 + f64::from(scan) * 0.101_7;
        format!("FLASER 181 {ranges}{x} 0.001 0.0007 {x} 0.001 0.0007 {stamp_s} host {stamp_s}\n")
    };
    let path = folder.join("drive.clf");
    fs::write(&path, (0..60).map(line).collect::<String>()).unwrap();
    path
}

#[test]
fn a_recording_played_live_gives_what_run_gives_and_so_does_its_recording() {
    let folder = tempfile::tempdir().unwrap();
    let at_out = |name: &str| folder.path().join(name).display().to_string();
    let carmen = carmen_log(folder.path()).display().to_string();
    floorprint(&["run", &carmen, "--out", &at_out("carmen")], 0);
    for (name, recording, expected) in [("drive", at("drive"), at("run")), ("log", carmen, at_out("carmen"))] {
        let [out, record, again] = ["live", "mcap", "again"].map(|ending| at_out(&format!("{name}.{ending}")));
        let options = ["live", "--play", &recording, "--rate", "0", "--record", &record, "--out", &out];
        floorprint(&options, 0);
        assert_same(expected.as_ref(), out.as_ref());
        // What was recorded says the same, to the byte.
        floorprint(&["run", &record, "--out", &again], 0);
        assert_same(expected.as_ref(), again.as_ref());
        assert!(!Path::new(&(record.clone() + ".active")).exists());
        let said = floorprint(&options, 1);
        assert!(said.contains("a file stands there") || said.contains("--force"), "{said}");
    }
}

/// Lines of JSON of the shared drive's first scans, with the truth as odometry.
fn json_lines(scans: usize) -> String {
    let mut lines = String::new();
    for scan in 0..scans {
        let (stamp, x) = (0.1 * scan as f64, 0.02 * scan as f64);
        lines += &format!("{{\"type\":\"odometry\",\"stamp\":{stamp},\"x\":{x},\"y\":0,\"theta\":0}}\n");
        let range = |ray: usize| 3.0 - x + 0.2 * ((ray / 30) % 2) as f64;
        let ranges: Vec<String> = (0..180).map(|ray| format!("{:.3}", range(ray))).collect();
        lines += &format!(
            "{{\"type\":\"scan\",\"stamp\":{stamp},\"angle_min\":-1.5,\"angle_increment\":0.0167,\"ranges\":[{}]}}\n",
            ranges.join(",")
        );
    }
    lines
}

/// Starts a session that reads lines.
fn reading(arguments: &[&str]) -> Child {
    let mut command = command(&[&["live", "-"], arguments].concat());
    command.stdin(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap()
}

#[test]
fn lines_on_standard_input_are_mapped_and_wrong_ones_are_named() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("out");
    let mut child = reading(&["--out", out.to_str().unwrap()]);
    let mut input = child.stdin.take().unwrap();
    input.write_all(json_lines(40).as_bytes()).unwrap();
    input.write_all(b"{\"type\":\"scna\",\"stamp\":1}\n").unwrap();
    drop(input);
    let Output { status, stderr, .. } = child.wait_with_output().unwrap();
    let said = String::from_utf8_lossy(&stderr);
    assert_eq!(status.code(), Some(0), "{said}");
    assert!(said.contains("line 81: unknown variant `scna`"), "{said}");
    let report: serde_json::Value = serde_json::from_slice(&fs::read(out.join("live.json")).unwrap()).unwrap();
    assert_eq!((report["scans"].as_u64(), report["finished"].as_bool()), (Some(40), Some(true)));
    assert!(fs::read_to_string(out.join("trajectory.tum")).unwrap().lines().count() >= 40);
}

/// Waits until something holds.
fn wait_for(what: &str, mut holds: impl FnMut() -> bool) {
    let end = Instant::now() + Duration::from_secs(20);
    while !holds() {
        assert!(Instant::now() < end, "{what} does not come");
        sleep(Duration::from_millis(50));
    }
}

fn frames(session: &Path) -> usize {
    let info = floorprint(&["map", "info", session.to_str().unwrap()], 0);
    let line = info.lines().find(|line| line.starts_with("trajectory")).unwrap();
    line.split_once(" m, ").unwrap().1.split_once(" frames").unwrap().0.parse().unwrap()
}

#[cfg(unix)]
#[test]
fn a_session_that_is_ended_by_a_signal_or_killed_is_gone_on_with() {
    let folder = tempfile::tempdir().unwrap();
    let (session, record) = (folder.path().join("site.gpkg"), folder.path().join("killed.mcap"));
    let [path, recording] = [&session, &record].map(|path| path.to_str().unwrap());
    let lines = json_lines(60);
    // Killed: what was saved is there.
    let mut child = reading(&["--session", path, "--record", recording]);
    let mut input = child.stdin.take().unwrap();
    input.write_all(lines.as_bytes()).unwrap();
    let mut later = 60;
    wait_for("a save", || {
        // Saves come with records.
        input
            .write_all(json_lines(later + 1).lines().skip(2 * later).collect::<Vec<_>>().join("\n").as_bytes())
            .unwrap();
        input.write_all(b"\n").unwrap();
        later += 1;
        later > 80 && command(&["map", "info", path]).output().unwrap().status.success()
    });
    child.kill().unwrap();
    child.wait().unwrap();
    let saved = frames(&session);
    assert!(saved >= 60, "{saved}");
    let active = folder.path().join("killed.mcap.active");
    let out = folder.path().join("again");
    floorprint(&["run", active.to_str().unwrap(), "--out", out.to_str().unwrap()], 0);
    // Gone on with, and ended by a signal: within a second, with everything saved.
    let mut child = reading(&["--session", path]);
    let mut input = child.stdin.take().unwrap();
    let further = json_lines(160).lines().skip(2 * later).collect::<Vec<_>>().join("\n") + "\n";
    input.write_all(further.as_bytes()).unwrap();
    sleep(Duration::from_millis(1500));
    let asked = Instant::now();
    Command::new("kill").args(["-TERM", &child.id().to_string()]).status().unwrap();
    let status = child.wait().unwrap();
    assert!(asked.elapsed() < Duration::from_secs(3), "{:?}", asked.elapsed());
    assert!(matches!(status.code(), Some(0 | 130)), "{status}");
    assert!(frames(&session) > saved + 50, "{} of {saved}", frames(&session));
    let left: Vec<String> =
        fs::read_dir(folder.path()).unwrap().map(|entry| entry.unwrap().file_name().into_string().unwrap()).collect();
    assert!(!left.iter().any(|name| name.ends_with("-wal") || name.contains("unfinished")), "{left:?}");
}

/// Lines of a robot at `x` metres in a room: odometry, and a scan.
fn in_room(stamp: f64, x: f64) -> [String; 2] {
    let range = |ray: usize| {
        let (sin, cos) = (-1.5 + 0.0167 * ray as f64).sin_cos();
        let to_end = if cos > 0.0 { (5.0 - x) / cos } else { (-2.0 - x) / cos };
        to_end.min(if sin > 0.0 { 2.0 / sin } else { -2.5 / sin })
    };
    let ranges: Vec<String> = (0..180).map(|ray| format!("{:.3}", range(ray))).collect();
    [
        format!("{{\"type\":\"odometry\",\"stamp\":{stamp},\"x\":{x},\"y\":0,\"theta\":0}}\n"),
        format!(
            "{{\"type\":\"scan\",\"stamp\":{stamp},\"angle_min\":-1.5,\"angle_increment\":0.0167,\"ranges\":[{}]}}\n",
            ranges.join(",")
        ),
    ]
}

/// Ends the input, waits, and gives what was said with the report and the last pose's x.
fn ended(mut child: Child, out: &Path) -> (String, serde_json::Value, f64) {
    drop(child.stdin.take());
    let Output { status, stderr, .. } = child.wait_with_output().unwrap();
    let said = String::from_utf8_lossy(&stderr).into_owned();
    assert_eq!(status.code(), Some(0), "{said}");
    let report = serde_json::from_slice(&fs::read(out.join("live.json")).unwrap()).unwrap();
    let trajectory = fs::read_to_string(out.join("trajectory.tum")).unwrap();
    (said, report, trajectory.lines().last().unwrap().split(' ').nth(1).unwrap().parse().unwrap())
}

#[test]
fn a_clock_that_is_set_is_told_and_the_robot_is_followed() {
    let drive = |input: &mut dyn std::io::Write, step_s: f64| {
        for scan in 0..120 {
            let stamp = 10_000.0 + 0.1 * f64::from(scan) + if scan < 60 { 0.0 } else { step_s };
            input.write_all(in_room(stamp, 0.01 * f64::from(scan)).concat().as_bytes()).unwrap();
        }
    };
    // The last one is as small as those that NTP makes: such stamps are late messages, and nothing is told.
    for step_s in [3600.0, -3600.0, -5.0, -0.4] {
        let folder = tempfile::tempdir().unwrap();
        let out = folder.path().join("out");
        let mut child = reading(&["--out", out.to_str().unwrap()]);
        drive(child.stdin.as_mut().unwrap(), step_s);
        let (said, report, x) = ended(child, &out);
        let told = ["stamps go on by", "stamps go back by"].map(|told| said.contains(told));
        assert_eq!(told, [step_s > 0.0, step_s < -1.0], "{step_s}: {said}");
        assert_eq!(report["scans"], 120);
        assert!((x - 1.19).abs() < 0.03, "{step_s}: {x}");
        // In the finished map as well.
        let (map, out) = (out.join("session.gpkg"), folder.path().join("followed"));
        let options = ["--map", map.to_str().unwrap(), "--pose", "0,0,0", "--out", out.to_str().unwrap()];
        let mut child = reading(&options);
        drive(child.stdin.as_mut().unwrap(), step_s);
        let (_, report, x) = ended(child, &out);
        assert_eq!(report["scans"], 120);
        assert!((x - 1.19).abs() < 0.05, "{step_s}: {x}");
    }
}

#[test]
fn a_lidar_that_vanishes_is_told_and_found_again() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("out");
    let mut child = reading(&["--out", out.to_str().unwrap()]);
    let input = child.stdin.as_mut().unwrap();
    for scan in 0..100 {
        let [odometry, line] = in_room(10_000.0 + 0.1 * f64::from(scan), 0.01 * f64::from(scan));
        input.write_all(odometry.as_bytes()).unwrap();
        if (40..70).contains(&scan) {
            sleep(Duration::from_millis(80));
        } else {
            input.write_all(line.as_bytes()).unwrap();
        }
    }
    let (said, report, x) = ended(child, &out);
    assert_eq!(said.matches("no scan comes any more").count(), 1, "{said}");
    assert!(said.contains("scans come again, after 2."), "{said}");
    assert_eq!(report["scans"], 70);
    assert!((x - 0.99).abs() < 0.03, "{x}");
}

#[test]
fn a_session_is_worked_on_by_one_process() {
    let folder = tempfile::tempdir().unwrap();
    let session = folder.path().join("site.gpkg").display().to_string();
    let mut first = reading(&["--session", &session]);
    let lock = folder.path().join(".site.gpkg.lock");
    wait_for("the first process", || fs::read_to_string(&lock).is_ok_and(|owner| !owner.is_empty()));
    let said = floorprint(&["live", "-", "--session", &session], 1);
    assert!(said.contains(&format!("another process (number {}) works on it", first.id())), "{said}");
    // However the first one ends, the next one may go on.
    first.kill().unwrap();
    first.wait().unwrap();
    floorprint(&["live", "-", "--session", &session], 0);
    assert!(!lock.exists());
}

/// Kills each of five robots' sessions four times, at another moment each time; `FLOORPRINT_KILLS` of them all, where it says so.
#[cfg(unix)]
#[test]
fn kills_lose_nothing_that_was_saved() {
    let times = std::env::var("FLOORPRINT_KILLS").map_or(4, |kills| kills.parse::<u64>().unwrap().div_ceil(5));
    let folder = tempfile::tempdir().unwrap();
    std::thread::scope(|scope| {
        for robot in 0..5 {
            let session = folder.path().join(format!("site-{robot}.gpkg"));
            scope.spawn(move || {
                let (mut scan, mut saved) = (0, 0);
                for kill in 0..times {
                    let mut child = reading(&["--session", session.to_str().unwrap(), "--quiet"]);
                    let input = child.stdin.as_mut().unwrap();
                    // Saves come each second; the end comes at another moment of it each time.
                    let end = Instant::now() + Duration::from_millis(1050 + 83 * (times * robot + kill) % 600);
                    while Instant::now() < end {
                        let stamp = 10_000.0 + 0.1 * f64::from(scan);
                        let x = 1.0 - (0.01 * f64::from(scan)).cos();
                        if input.write_all(in_room(stamp, x).concat().as_bytes()).is_err() {
                            break;
                        }
                        scan += 1;
                        sleep(Duration::from_millis(5));
                    }
                    child.kill().unwrap();
                    child.wait().unwrap();
                    if session.exists() {
                        let now = frames(&session);
                        assert!(now >= saved, "{now} of {saved} frames");
                        saved = now;
                    }
                }
                assert!(saved > 0, "nothing was saved in {scan} scans");
            });
        }
    });
    // What was cut off in the middle of a save is taken up by the next one.
    let session = folder.path().join("site-0.gpkg");
    let before = frames(&session);
    let mut child = reading(&["--session", session.to_str().unwrap()]);
    let input = child.stdin.as_mut().unwrap();
    (0..20).for_each(|scan| {
        input.write_all(in_room(20_000.0 + 0.1 * f64::from(scan), 0.0).concat().as_bytes()).unwrap();
    });
    drop(child.stdin.take());
    assert!(child.wait().unwrap().success());
    assert_eq!(frames(&session), before + 20);
}

#[test]
fn a_robot_is_followed_in_a_finished_map() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("out");
    let map = at("run/session.gpkg");
    let options = ["--map", &map, "--pose", "0,0,0", "--rate", "0", "--out", out.to_str().unwrap()];
    floorprint(&[&["live", "--play", &at("drive")], &options[..]].concat(), 0);
    let read = |path: PathBuf| fs::read_to_string(path).unwrap();
    let followed = read(out.join("trajectory.tum"));
    let mapped = read(Path::new(&at("run")).join("trajectory.tum"));
    let position = |line: &str| {
        let mut numbers = line.split(' ').skip(1).map(|number| number.parse::<f64>().unwrap());
        [numbers.next().unwrap(), numbers.next().unwrap()]
    };
    let (followed, mapped): (Vec<_>, Vec<_>) =
        (followed.lines().map(position).collect(), mapped.lines().map(position).collect());
    assert!(followed.len() + 5 >= mapped.len(), "{} of {}", followed.len(), mapped.len());
    let [end, expected] = [followed.last().unwrap(), mapped.last().unwrap()];
    assert!((end[0] - expected[0]).hypot(end[1] - expected[1]) < 0.1, "{end:?}, {expected:?}");
}

#[test]
fn what_cannot_be_asked_for_is_said() {
    for (arguments, expected) in [
        (&["live"][..], "--play"),
        (&["live", "drive.bag"], "--play drive.bag"),
        (&["live", "-", "--rate", "2"], "--play"),
        (&["live", "--play", "x", "--rate", "-1"], "0.01 to 1000"),
        (&["live", "-", "--map", "m.yaml", "--record", "r.mcap"], "cannot be used with"),
    ] {
        let said = floorprint(arguments, 2);
        assert!(said.contains(expected), "{arguments:?}: {said}");
    }
    let said = floorprint(&["live", "--play", "nowhere.bag"], 1);
    assert!(said.contains("no such file"), "{said}");
}

/// A session with a page, fed by the test.
struct Watched {
    child: Child,
    address: String,
}

impl Watched {
    fn start(arguments: &[&str]) -> Self {
        let mut child = reading(&[arguments, &["--http", "127.0.0.1:0"]].concat());
        let address = page_address(&mut child);
        Self { child, address }
    }

    /// Kilobytes of memory that the session holds; 0 where the system does not say.
    fn memory_kb(&self) -> u64 {
        let status = fs::read_to_string(format!("/proc/{}/status", self.child.id())).unwrap_or_default();
        let line = status.lines().find_map(|line| line.strip_prefix("VmRSS:")).unwrap_or("0");
        line.split_whitespace().next().unwrap().parse().unwrap()
    }

    /// The answer to a request with these headers.
    fn ask(&self, request: &str, headers: &[&str], body: &str) -> String {
        let mut stream = TcpStream::connect(&self.address).unwrap();
        stream.set_read_timeout(Some(Duration::from_secs(5))).unwrap();
        let headers: String = headers.iter().map(|header| format!("{header}\r\n")).collect();
        let length = body.len();
        let host = &self.address;
        let head = format!(
            "{request} HTTP/1.1\r\nHost: {host}\r\nConnection: close\r\nContent-Length: {length}\r\n{headers}\r\n"
        );
        stream.write_all((head + body).as_bytes()).unwrap();
        let mut answer = Vec::new();
        let _ = stream.read_to_end(&mut answer);
        String::from_utf8_lossy(&answer).into_owned()
    }
}

/// Waits until a program says where its page is.
fn page_address(child: &mut Child) -> String {
    let mut said = BufReader::new(child.stderr.take().unwrap());
    let mut line = String::new();
    while !line.contains("the page is at") {
        line.clear();
        assert!(said.read_line(&mut line).unwrap() > 0, "no page");
    }
    // Nobody reads the rest, and it is not waited for.
    std::thread::spawn(move || said.lines().for_each(drop));
    line.split("http://").nth(1).unwrap().split('/').next().unwrap().to_owned()
}

impl Drop for Watched {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

#[test]
fn the_page_shows_the_map_and_stands_floods() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("out");
    let mut watched = Watched::start(&["--out", out.to_str().unwrap()]);
    let mut input = watched.child.stdin.take().unwrap();
    input.write_all(json_lines(40).as_bytes()).unwrap();
    let page = watched.ask("GET /", &[], "");
    assert!(
        page.starts_with("HTTP/1.1 200") && page.contains("default-src 'none'") && page.contains("<canvas"),
        "{page}"
    );
    // The map comes with the scans.
    let mut later = 40;
    wait_for("the map", || {
        let lines = json_lines(later + 1);
        input
            .write_all(lines.lines().skip(2 * later).map(|line| format!("{line}\n")).collect::<String>().as_bytes())
            .unwrap();
        later += 1;
        watched.ask("GET /map.yaml", &[], "").contains("resolution: 0.05")
    });
    assert!(watched.ask("GET /tiles/0/0/0?v=1", &[], "").contains("PNG"));
    for (request, headers, status) in [
        ("GET /tiles/9/0/0", &[][..], "404"),
        ("GET /tiles/0/2147483647/-2147483648", &[], "404"),
        ("GET /../etc/passwd", &[], "404"),
        ("POST /pose", &["Content-Type: application/json"], "409"),
        ("POST /pause", &["Content-Type: text/plain"], "415"),
        ("POST /pause", &["Content-Type: application/json", "Origin: http://evil.example"], "403"),
        ("DELETE /", &[], "405"),
    ] {
        let answer = watched.ask(request, headers, "{}");
        assert!(answer.starts_with(&format!("HTTP/1.1 {status}")), "{request}: {answer}");
    }
    let long = "x".repeat(10_000);
    assert!(watched.ask("POST /pause", &["Content-Type: application/json"], &long).starts_with("HTTP/1.1 413"));
    // Connections that say nothing, talk nonsense without end or never end; a viewer that never reads.
    let before_kb = watched.memory_kb();
    let garbage: Vec<u8> = (0..1 << 20).map(|at: u32| (at.wrapping_mul(2_654_435_761) >> 24) as u8 | 0x20).collect();
    let flood: Vec<TcpStream> = (0..300)
        .filter_map(|number| {
            let mut stream = TcpStream::connect(&watched.address).ok()?;
            stream.set_write_timeout(Some(Duration::from_millis(100))).ok()?;
            let bytes: &[u8] = match number % 5 {
                0 => b"",
                1 => b"\xff\xfe\x00 nonsense\r\n\r\n",
                2 => b"GET / HTTP/1.1\r\nX: ",
                3 => &garbage,
                _ => b"GET /events HTTP/1.1\r\nHost: localhost\r\n\r\n",
            };
            let _ = stream.write_all(bytes);
            Some(stream)
        })
        .collect();
    let asked = Instant::now();
    for _ in 0..20 {
        assert!(watched.ask("GET /page.js", &[], "").contains("HTTP/1.1 200"));
    }
    assert!(asked.elapsed() < Duration::from_secs(5), "{:?}", asked.elapsed());
    let grown_kb = watched.memory_kb().saturating_sub(before_kb);
    assert!(grown_kb < 40_000, "{grown_kb} kB more");
    drop(flood);
    // The session went on.
    drop(input);
    assert!(watched.child.wait().unwrap().success());
    assert!(out.join("map.pgm").exists());
}

/// Numbers that look like chance and are the same each time (xorshift).
fn random_bytes(state: &mut u64, count: usize) -> Vec<u8> {
    let mut byte = || {
        *state ^= *state << 13;
        *state ^= *state >> 7;
        *state ^= *state << 17;
        *state as u8
    };
    (0..count).map(|_| byte()).collect()
}

#[test]
fn random_bytes_and_spoilt_requests_end_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let mut watched = Watched::start(&["--out", folder.path().join("out").to_str().unwrap()]);
    let mut input = watched.child.stdin.take().unwrap();
    input.write_all(json_lines(20).as_bytes()).unwrap();
    let before_kb = watched.memory_kb();
    let body = r#"{"revision":0,"places":[{"name":"dock","at":[1,2]}],"keep_out":[[[0,0],[1,0],[1,1]]]}"#;
    let request = format!(
        "POST /annotations HTTP/1.1\r\nHost: {}\r\nContent-Type: application/json\r\nContent-Length: {}\r\n\r\n{body}",
        watched.address,
        body.len()
    );
    let mut state = 0x9e37_79b9_7f4a_7c15;
    for number in 0..600 {
        let mut bytes = request.clone().into_bytes();
        match number % 3 {
            // Nothing but chance.
            0 => bytes = random_bytes(&mut state, 700),
            // Some bytes of a request are others.
            1 => {
                for _ in 0..4 {
                    let spoilt = random_bytes(&mut state, 3);
                    let at = usize::from(u16::from_le_bytes([spoilt[0], spoilt[1]])) % bytes.len();
                    bytes[at] = spoilt[2];
                }
            }
            // It ends too early.
            _ => bytes.truncate(number % request.len()),
        }
        let Ok(mut stream) = TcpStream::connect(&watched.address) else { continue };
        let _ = stream.set_write_timeout(Some(Duration::from_millis(100)));
        let _ = stream.write_all(&bytes);
    }
    // The bucket of requests fills again.
    sleep(Duration::from_millis(500));
    assert!(watched.ask("GET /page.js", &[], "").starts_with("HTTP/1.1 200"));
    let grown_kb = watched.memory_kb().saturating_sub(before_kb);
    assert!(grown_kb < 40_000, "{grown_kb} kB more");
    drop(input);
    assert!(watched.child.wait().unwrap().success());
}

/// The overlay's revision as viewers are told it.
fn revision(watched: &Watched) -> u64 {
    overlay(watched)["revision"].as_u64().unwrap()
}

/// What lies over the map, as viewers are told it.
fn overlay(watched: &Watched) -> serde_json::Value {
    let mut stream = TcpStream::connect(&watched.address).unwrap();
    stream.set_read_timeout(Some(Duration::from_secs(20))).unwrap();
    let request = format!("GET /events HTTP/1.1\r\nHost: {}\r\n\r\n", watched.address);
    stream.write_all(request.as_bytes()).unwrap();
    let mut lines = BufReader::new(stream).lines().map(Result::unwrap);
    lines.find(|line| line == "event: overlay").unwrap();
    serde_json::from_str(lines.next().unwrap().strip_prefix("data: ").unwrap()).unwrap()
}

/// How many cells of the map that the page shows are black.
fn black(watched: &Watched, picture: &str) -> usize {
    let mut stream = TcpStream::connect(&watched.address).unwrap();
    let request = format!("GET {picture} HTTP/1.1\r\nHost: {}\r\nConnection: close\r\n\r\n", watched.address);
    stream.write_all(request.as_bytes()).unwrap();
    let mut answer = Vec::new();
    stream.read_to_end(&mut answer).unwrap();
    assert!(answer.starts_with(b"HTTP/1.1 200"), "{picture}");
    let pixels = answer.windows(5).position(|window| window == b"\n255\n").unwrap() + 5;
    answer[pixels..].iter().filter(|&&level| level == 0).count()
}

const JSON: [&str; 1] = ["Content-Type: application/json"];

#[test]
fn a_map_is_changed_while_it_is_made() {
    let folder = tempfile::tempdir().unwrap();
    let session = folder.path().join("site.gpkg");
    let mut watched = Watched::start(&["--session", session.to_str().unwrap()]);
    let mut input = watched.child.stdin.take().unwrap();
    let mut scan = 0;
    let mut drive = |scans: i32| {
        for _ in 0..scans {
            input
                .write_all(in_room(100.0 + 0.1 * f64::from(scan), 0.01 * f64::from(scan)).concat().as_bytes())
                .unwrap();
            scan += 1;
        }
    };
    drive(40);
    wait_for("the map", || {
        drive(1);
        watched.ask("GET /map.yaml", &[], "").starts_with("HTTP/1.1 200")
    });
    // Places and areas: whoever is late is told so, and nonsense changes nothing.
    let notes = |revision: u64, name: &str| {
        let keep_out = "[[[1,-1],[2,-1],[2,1],[1,1]]]";
        let body =
            format!(r#"{{"revision":{revision},"places":[{{"name":"{name}","at":[1,0.5]}}],"keep_out":{keep_out}}}"#);
        watched.ask("POST /annotations", &JSON, &body)
    };
    let first = revision(&watched);
    assert!(notes(first, "dock").starts_with("HTTP/1.1 204"));
    assert!(notes(first, "late").starts_with("HTTP/1.1 409") && notes(first + 1, "").starts_with("HTTP/1.1 400"));
    let exported = watched.ask("GET /annotations.geojson", &[], "");
    assert!(exported.contains(r#"{"name":"dock"}"#) && exported.contains("keep_out"), "{exported}");
    // 1 m by 2 m at 0.05 m.
    assert!((760..=840).contains(&black(&watched, "/keepout.pgm")), "{}", black(&watched, "/keepout.pgm"));
    // The wall at y = 2 goes; what was mapped until then stays beside.
    let before = black(&watched, "/map.pgm");
    let wall = r#"{"keep":"outside","polygon":[[-3,1.5],[6,1.5],[6,2.5],[-3,2.5]]}"#;
    for (headers, body, status) in [
        (&["Content-Type: text/plain"][..], wall, "415"),
        (&["Content-Type: application/json", "Origin: http://evil.example"], wall, "403"),
        (&JSON, r#"{"keep":"outside","polygon":[[0,0],[1,1]]}"#, "400"),
        (&JSON, r#"{"keep":"inside","polygon":[[90,90],[91,90],[91,91]]}"#, "422"),
        (&JSON, wall, "204"),
    ] {
        let answer = watched.ask("POST /restrict", headers, body);
        assert!(answer.starts_with(&format!("HTTP/1.1 {status}")), "{body}: {answer}");
    }
    wait_for("the changed map", || black(&watched, "/map.pgm") < before - 20);
    let aside = folder.path().join("site-2.gpkg");
    assert!(frames(&aside) >= 40);
    // The drive goes on, and sees the wall again.
    let erased = black(&watched, "/map.pgm");
    let began = frames(&session);
    wait_for("the wall", || {
        drive(1);
        black(&watched, "/map.pgm") > erased + 20
    });
    drop(input);
    assert!(watched.child.wait().unwrap().success());
    assert!(frames(&session) > began);
    // What was said of the map is in the session, and goes where its map goes.
    let out = folder.path().join("export").display().to_string();
    floorprint(&["map", "export", session.to_str().unwrap(), "--out", &out], 0);
    let exported = fs::read_to_string(Path::new(&out).join("annotations.geojson")).unwrap();
    assert!(exported.contains("dock") && Path::new(&out).join("keepout.pgm").is_file(), "{exported}");
}

/// A finished session that is shown.
fn viewing(arguments: &[&str]) -> Watched {
    let mut child = command(&[&["view"], arguments].concat()).stderr(Stdio::piped()).spawn().unwrap();
    let address = page_address(&mut child);
    Watched { child, address }
}

#[test]
fn a_finished_map_is_changed_where_that_is_wanted_and_compared() {
    let folder = tempfile::tempdir().unwrap();
    let site = folder.path().join("site.gpkg");
    fs::copy(at("run/session.gpkg"), &site).unwrap();
    let path = site.to_str().unwrap();
    let part = r#"{"keep":"outside","polygon":[[-2,-3],[2,-3],[2,3],[-2,3]]}"#;
    let read_only = viewing(&[path]);
    assert!(read_only.ask("POST /restrict", &JSON, part).starts_with("HTTP/1.1 409"));
    let notes = r#"{"revision":1,"places":[{"name":"dock","at":[1,0.5]}],"keep_out":[]}"#;
    assert!(read_only.ask("POST /annotations", &JSON, notes).starts_with("HTTP/1.1 409"));
    drop(read_only);
    assert!(fs::read(&site).unwrap() == fs::read(at("run/session.gpkg")).unwrap());
    let edited = viewing(&[path, "--edit"]);
    let before = black(&edited, "/map.pgm");
    assert!(edited.ask("POST /annotations", &JSON, notes).starts_with("HTTP/1.1 204"));
    assert!(edited.ask("POST /restrict", &JSON, part).starts_with("HTTP/1.1 204"));
    assert!(black(&edited, "/map.pgm") < before);
    drop(edited);
    // It is in the file, and the file of before beside it.
    let again = viewing(&[path]);
    assert!(black(&again, "/map.pgm") < before && again.ask("GET /annotations.geojson", &[], "").contains("dock"));
    drop(again);
    let aside = folder.path().join("site-2.gpkg");
    let compared = viewing(&[aside.to_str().unwrap(), "--compare", path]);
    assert_eq!(black(&compared, "/map.pgm"), before);
    let changes = overlay(&compared)["changes"].clone();
    let gone = changes.as_array().unwrap().iter().filter(|change| change["isNew"] == false).count();
    assert!(gone > 0, "{changes}");
}

#[test]
fn others_come_in_with_the_token_only() {
    let session = tempfile::tempdir().unwrap();
    let session = session.path().join("site.gpkg").display().to_string();
    let refused = floorprint(&["live", "-", "--http", "0.0.0.0:0", "--session", &session], 2);
    assert!(refused.contains("--token"), "{refused}");
    let watched = Watched::start(&["--session", &session, "--token", "0123456789abcdef"]);
    assert!(watched.ask("GET /", &[], "").starts_with("HTTP/1.1 401"));
    assert!(watched.ask("GET /map.pgm?token=0123456789abcdee", &[], "").starts_with("HTTP/1.1 401"));
    let answer = watched.ask("GET /?token=0123456789abcdef", &[], "");
    assert!(answer.starts_with("HTTP/1.1 303") && answer.contains("HttpOnly; SameSite=Strict"), "{answer}");
    assert!(watched.ask("GET /", &["Cookie: floorprint=0123456789abcdef"], "").starts_with("HTTP/1.1 200"));
}
