//! The commands of the guide do what it says, one after the other, and its figures are true.

use std::fs;
use std::path::Path;
use std::process::Command;

/// The commands that a document shows, in order.
fn commands(document: &str) -> Vec<Vec<&str>> {
    let blocks = document.split("```").skip(1).step_by(2);
    let lines = blocks.filter_map(|block| block.strip_prefix("sh\n")).flat_map(str::lines);
    lines.map(|line| line.split_whitespace().collect()).collect()
}

#[test]
fn the_guide_can_be_followed() {
    let docs = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../docs");
    let guide = fs::read_to_string(docs.join("guide.md")).unwrap();
    let folder = tempfile::tempdir().unwrap();
    let mut printed = String::new();
    for command in commands(&guide) {
        assert_eq!(command[0], "floorprint");
        let output = Command::new(env!("CARGO_BIN_EXE_floorprint")).args(&command[1..]).current_dir(&folder).output();
        let output = output.unwrap();
        assert!(output.status.success(), "{command:?}: {}", String::from_utf8_lossy(&output.stderr));
        printed.push_str(&String::from_utf8_lossy(&output.stdout));
    }
    let rmse_m: Vec<f64> = printed
        .lines()
        .filter_map(|line| line.strip_prefix("trajectory  RMSE ")?.split_whitespace().next()?.parse().ok())
        .collect();
    // The report's filter, the default, and the default once more.
    assert!((0.04..0.1).contains(&rmse_m[0]) && rmse_m[1] < 0.004 && rmse_m[2] == rmse_m[1], "{rmse_m:?}");
    assert!(folder.path().join("compare.html").is_file());
    // What it links to and shows is there.
    for link in guide.split("](").skip(1).filter_map(|rest| rest.split(')').next()) {
        assert!(docs.join(link).exists(), "{link}");
    }
}
