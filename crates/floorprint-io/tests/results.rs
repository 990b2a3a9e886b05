//! Results are written whole or not at all, and are read again as they were written.

use floorprint::map::{Occupancy, Raster};
use floorprint_io::{RunFolder, read_floor, read_map, write_file, write_floor, write_map};
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

#[test]
fn a_run_appears_when_it_is_complete() {
    let folder = tempfile::tempdir().unwrap();
    let target = folder.path().join("runs/first");
    let run = RunFolder::create(&target, false).unwrap();
    write_file(&run.path().join("report.json"), b"1").unwrap();
    assert!(!target.exists());
    run.finish().unwrap();
    assert_eq!(names(&folder.path().join("runs")), ["first"]);
    assert_eq!(names(&target), ["report.json"]);

    assert!(RunFolder::create(&target, false).unwrap_err().problem().advice.contains("--force"));
    let abandoned = RunFolder::create(&target, true).unwrap();
    write_file(&abandoned.path().join("report.json"), b"2").unwrap();
    drop(abandoned);
    assert_eq!(fs::read(target.join("report.json")).unwrap(), b"1");

    let second = RunFolder::create(&target, true).unwrap();
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
        assert!(RunFolder::create(folder.path(), replace).is_err());
        assert!(RunFolder::create(&folder.path().join("precious.txt"), replace).is_err());
    }
    assert!(RunFolder::create(&folder.path().join("precious.txt/run"), true).is_err());
    assert!(RunFolder::create(Path::new("/"), true).is_err());
    assert_eq!(names(folder.path()), ["precious.txt"]);
}
