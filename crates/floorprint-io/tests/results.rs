//! Results are written whole or not at all, and are read again as they were written.

use floorprint::map::{Occupancy, Raster};
use floorprint_io::{Contents, RunFolder, read_floor, read_map, write_file, write_files, write_floor, write_map};
use std::fs;
use std::path::Path;

/// Names in a folder, sorted.
fn names(folder: &Path) -> Vec<String> {
    let entries = fs::read_dir(folder).into_iter().flatten().flatten();
    let mut names: Vec<_> = entries.map(|entry| entry.file_name().to_string_lossy().into_owned()).collect();
    names.sort();
    names
}

#[test]
fn maps_and_floors_are_read_as_written() {
    let folder = tempfile::tempdir().unwrap();
    let cells = [Occupancy::Unknown, Occupancy::Free, Occupancy::Occupied];
    let map = Raster {
        width: 3,
        height: 2,
        resolution_m: 0.05,
        origin_m: [-1.25, 7.0],
        cells: (0..6).map(|index| cells[index % 3]).collect(),
    };
    write_map(&folder.path().join("map.yaml"), &map).unwrap();
    assert_eq!(read_map(&folder.path().join("map.yaml")).unwrap(), map);
    assert_eq!(read_map(&folder.path().join("map.pgm")).unwrap(), map);

    let floor = map.map(|index, _| (index % 3 != 0).then_some([index as u8, 110, 110]));
    write_floor(&folder.path().join("texture.png"), &floor).unwrap();
    assert_eq!(read_floor(&folder.path().join("texture.json")).unwrap(), floor);
    assert_eq!(names(folder.path()), ["map.pgm", "map.yaml", "texture.json", "texture.png"]);
}

/// A report of a run as far as it is looked at before the run is replaced.
const REPORT: &[u8] = br#"{"what": "results of floorprint run", "version": "1", "partial": false}"#;

#[test]
fn a_run_appears_when_it_is_complete() {
    let folder = tempfile::tempdir().unwrap();
    let target = folder.path().join("runs/first");
    let run = RunFolder::create(&target, Contents::Run, false).unwrap();
    write_file(&run.path().join("report.json"), REPORT).unwrap();
    assert!(!target.exists());
    run.finish().unwrap();
    assert_eq!(names(&folder.path().join("runs")), ["first"]);
    assert_eq!(names(&target), ["report.json"]);

    let advice = RunFolder::create(&target, Contents::Run, false).unwrap_err().problem().advice.clone();
    assert!(advice.contains("--force"), "{advice}");
    let abandoned = RunFolder::create(&target, Contents::Run, true).unwrap();
    write_file(&abandoned.path().join("report.json"), b"2").unwrap();
    drop(abandoned);
    assert_eq!(fs::read(target.join("report.json")).unwrap(), REPORT);

    let second = RunFolder::create(&target, Contents::Run, true).unwrap();
    write_file(&second.path().join("map.png"), b"3").unwrap();
    second.finish().unwrap();
    assert_eq!(names(&folder.path().join("runs")), ["first"]);
    assert_eq!(names(&target), ["map.png"]);
}

#[test]
fn only_results_are_ever_replaced() {
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("precious.txt"), "mine").unwrap();
    for replace in [false, true] {
        assert!(RunFolder::create(folder.path(), Contents::Run, replace).is_err());
        assert!(RunFolder::create(&folder.path().join("precious.txt"), Contents::Run, replace).is_err());
    }
    let error = RunFolder::create(&folder.path().join("precious.txt/run"), Contents::Run, true).unwrap_err();
    assert!(error.problem().advice.contains("another"), "{error}");
    assert!(RunFolder::create(Path::new("/"), Contents::Run, true).is_err());
    assert_eq!(names(folder.path()), ["precious.txt"]);
}

#[test]
fn a_run_with_other_files_in_it_is_not_replaced() {
    let folder = tempfile::tempdir().unwrap();
    let target = folder.path().join("run");
    fs::create_dir_all(target.join("snapshots")).unwrap();
    for name in ["graph.g2o", "snapshots/0012.png", "snapshots/animation.png"] {
        fs::write(target.join(name), "").unwrap();
    }
    // Reports of something else.
    for other in [&b"{}"[..], br#"{"version": "1"}"#, br#"{"what": "a simulated drive", "version": "1"}"#] {
        fs::write(target.join("report.json"), other).unwrap();
        assert!(RunFolder::create(&target, Contents::Run, true).is_err());
    }
    fs::write(target.join("report.json"), REPORT).unwrap();
    assert!(RunFolder::create(&target, Contents::Run, true).is_ok());
    // What was simulated is no run: it may be the input.
    fs::write(target.join("simulation.json"), REPORT).unwrap();
    assert!(RunFolder::create(&target, Contents::Run, true).is_err());
    fs::remove_file(target.join("simulation.json")).unwrap();
    for name in ["thesis.doc", "snapshots/best.png", "map2.png"] {
        fs::write(target.join(name), "mine").unwrap();
        let error = RunFolder::create(&target, Contents::Run, true).unwrap_err().to_string();
        assert!(error.contains(name), "{error}");
        fs::remove_file(target.join(name)).unwrap();
    }
}

#[test]
fn what_a_killed_process_left_is_swept_and_what_a_living_one_fills_is_not() {
    let folder = tempfile::tempdir().unwrap();
    let target = folder.path().join("run");
    let of_others = [".run.unfinished-1", ".run.unfinished-mine", ".runs.unfinished-1"];
    for name in of_others.iter().chain(&[".run.unfinished"]) {
        fs::create_dir(folder.path().join(name)).unwrap();
        fs::write(folder.path().join(name).join("map.png"), "").unwrap();
    }
    let lived = fs::File::open(folder.path().join(of_others[0])).unwrap();
    lived.lock().unwrap();
    drop(RunFolder::create(&target, Contents::Run, false).unwrap());
    assert_eq!(names(folder.path()), of_others);
    drop(lived);
    let run = RunFolder::create(&target, Contents::Run, false).unwrap();
    assert!(run.notes()[0].contains(".run.unfinished-1: left by a run that was stopped; removed"), "{:?}", run.notes());
    drop(run);
    assert_eq!(names(folder.path()), of_others[1..]);
}

#[test]
fn what_was_out_of_the_way_when_a_process_was_killed_is_put_back_and_that_is_told() {
    for name in [".run.replaced-1", ".run.replaced-4711", ".run.replaced"] {
        let folder = tempfile::tempdir().unwrap();
        let (target, replaced) = (folder.path().join("run"), folder.path().join(name));
        fs::create_dir(&replaced).unwrap();
        fs::write(replaced.join("report.json"), REPORT).unwrap();
        let error = RunFolder::create(&target, Contents::Run, false).unwrap_err();
        assert!(error.to_string().contains("an earlier run"), "{error}");
        assert_eq!(names(folder.path()), ["run"]);
        // Beside complete results it is in the way of nothing, and goes.
        fs::create_dir(&replaced).unwrap();
        fs::write(replaced.join("map.pgm"), "").unwrap();
        let run = RunFolder::create(&target, Contents::Run, true).unwrap();
        assert!(run.notes()[0].contains(name), "{:?}", run.notes());
        fs::write(run.path().join("report.json"), REPORT).unwrap();
        run.finish().unwrap();
        assert_eq!(names(folder.path()), ["run"]);
    }
}

#[test]
fn complete_results_that_a_killed_process_could_not_move_are_kept() {
    let folder = tempfile::tempdir().unwrap();
    let (target, unfinished) = (folder.path().join("run"), folder.path().join(".run.unfinished"));
    fs::create_dir(&unfinished).unwrap();
    fs::write(unfinished.join("report.json"), REPORT).unwrap();
    let run = RunFolder::create(&target, Contents::Run, false).unwrap();
    assert!(run.notes()[0].contains("run-2"), "{:?}", run.notes());
    drop(run);
    assert_eq!(names(folder.path()), ["run-2"]);
}

#[test]
fn files_that_are_put_there_meanwhile_stay_and_the_results_are_kept_beside() {
    for (replace, file) in [(false, "thesis.txt"), (true, "thesis.txt"), (true, "photos/a.jpg"), (true, "photos/")] {
        let folder = tempfile::tempdir().unwrap();
        let target = folder.path().join("run");
        if replace {
            fs::create_dir(&target).unwrap();
            fs::write(target.join("report.json"), REPORT).unwrap();
        }
        let run = RunFolder::create(&target, Contents::Run, replace).unwrap();
        fs::write(run.path().join("report.json"), REPORT).unwrap();
        fs::create_dir_all(target.join(file).parent().unwrap()).unwrap();
        if file.ends_with('/') {
            fs::create_dir_all(target.join(file)).unwrap();
        } else {
            fs::write(target.join(file), "mine").unwrap();
        }
        let error = run.finish().unwrap_err().to_string();
        assert!(error.contains("kept in") && error.contains("run-2"), "{error}");
        assert!(target.join(file).exists());
        assert_eq!(fs::read(folder.path().join("run-2/report.json")).unwrap(), REPORT);
        assert_eq!(names(folder.path()), ["run", "run-2"]);
    }
}

#[test]
fn two_cannot_fill_one_folder() {
    let folder = tempfile::tempdir().unwrap();
    let target = folder.path().join("run");
    let first = RunFolder::create(&target, Contents::Run, false).unwrap();
    let error = RunFolder::create(&target, Contents::Run, false).unwrap_err().to_string();
    assert!(error.contains("another process is filling it") && error.contains("choose another folder"), "{error}");
    fs::write(first.path().join("report.json"), REPORT).unwrap();
    first.finish().unwrap();
    assert_eq!(names(folder.path()), ["run"]);
}

#[test]
fn partial_results_never_replace_complete_ones() {
    let folder = tempfile::tempdir().unwrap();
    let target = folder.path().join("run");
    let partial = String::from_utf8_lossy(REPORT).replace("false", "true");
    let stop = || {
        let run = RunFolder::create(&target, Contents::Run, true).unwrap();
        fs::write(run.path().join("report.json"), &partial).unwrap();
        run.finish_partial().unwrap()
    };
    assert_eq!([stop(), stop()], [target.clone(), target.clone()]);
    let run = RunFolder::create(&target, Contents::Run, true).unwrap();
    fs::write(run.path().join("report.json"), REPORT).unwrap();
    run.finish().unwrap();
    assert_eq!(stop(), folder.path().join("run-2"));
    assert_eq!(fs::read(target.join("report.json")).unwrap(), REPORT);
    assert_eq!(names(folder.path()), ["run", "run-2"]);
}

#[test]
fn files_that_belong_together_are_replaced_together() {
    let folder = tempfile::tempdir().unwrap();
    let [first, second] = ["bench.md", "bench.json"].map(|name| folder.path().join(name));
    write_files(&[(&first, b"1"), (&second, b"1")]).unwrap();
    // Where the second cannot be written the first stays as it was.
    let nowhere = folder.path().join("nowhere/bench.json");
    assert!(write_files(&[(&first, b"2"), (&nowhere, b"2")]).is_err());
    assert_eq!([fs::read(&first).unwrap(), fs::read(&second).unwrap()], [b"1", b"1"]);
    assert_eq!(names(folder.path()), ["bench.json", "bench.md"]);
}

#[test]
fn an_attempt_leaves_no_folder_behind_that_it_made() {
    let folder = tempfile::tempdir().unwrap();
    fs::create_dir(folder.path().join("there")).unwrap();
    drop(RunFolder::create(&folder.path().join("there/deep/er/run"), Contents::Run, false).unwrap());
    assert_eq!(names(folder.path()), ["there"]);
    assert!(names(&folder.path().join("there")).is_empty());
}

#[cfg(unix)]
#[test]
fn a_link_to_a_run_stays_a_link() {
    let folder = tempfile::tempdir().unwrap();
    let (disk, link) = (folder.path().join("disk"), folder.path().join("run"));
    fs::create_dir(&disk).unwrap();
    std::os::unix::fs::symlink(&disk, &link).unwrap();
    for _ in 0..2 {
        let run = RunFolder::create(&link, Contents::Run, true).unwrap();
        write_file(&run.path().join("report.json"), REPORT).unwrap();
        run.finish().unwrap();
        assert!(link.is_symlink());
        assert_eq!(names(&disk), ["report.json"]);
    }
    assert_eq!(names(folder.path()), ["disk", "run"]);
    std::os::unix::fs::symlink(folder.path().join("nowhere"), folder.path().join("broken")).unwrap();
    assert!(RunFolder::create(&folder.path().join("broken"), Contents::Run, true).is_err());
}
