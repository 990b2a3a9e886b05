//! The benchmark's metric, on the logs' raw odometry, gives the figures measured independently.

mod data_folder;

use data_folder::data;
use floorprint::evaluation::RelationReport;
use floorprint::sensors::StampedPose;
use floorprint_io::{OpenOptions, open, read_relations};

#[test]
fn raw_odometry_has_its_known_error() {
    let Some(data) = data() else { return };
    for (name, relations, translation_m, rotation_deg) in
        [("intel", 2984, 7.37, 39.2), ("aces", 1279, 0.549, 2.33), ("mit-csail", 1172, 1.68, 5.07)]
    {
        let folder = data.join("relations").join(name);
        let log = open(&folder.join(format!("{name}.clf.gz")), &OpenOptions::default()).unwrap();
        let odometry: Vec<_> =
            log.scans().filter_map(|scan| Some(StampedPose { stamp_s: scan.stamp_s, pose: scan.odometry? })).collect();
        let truth = read_relations(&folder.join(format!("{name}.relations"))).unwrap();
        let report = RelationReport::new(&odometry, &truth).unwrap();
        assert_eq!((report.all.relations, report.all.matched), (relations, relations), "{name}");
        assert_eq!(report.short.relations + report.long.relations, relations, "{name}");
        let (translation, rotation) = (report.all.translation_m.unwrap(), report.all.rotation_deg.unwrap());
        assert!((translation.mean / translation_m - 1.0).abs() < 2e-3, "{name}: {translation:?}");
        assert!((rotation.mean / rotation_deg - 1.0).abs() < 3e-3, "{name}: {rotation:?}");
    }
}
