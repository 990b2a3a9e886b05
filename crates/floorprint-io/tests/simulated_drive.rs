//! A simulated drive is written in the course's layout and read back by the course's reader.

use floorprint::sensors::Record;
use floorprint::simulator::{SimulatedDrive, SimulationConfig, SimulationError, World, simulate};
use floorprint_io::{OpenOptions, open, read_floor, read_map, read_trajectory, write_ece276a};

fn small_drive() -> Result<SimulatedDrive, SimulationError> {
    let mut config = SimulationConfig::default();
    (config.lidar.beams, config.lidar.rate_hz, config.camera.rate_hz) = (271, 5.0, 0.1);
    simulate(World::named("rooms", 7)?, config, 7)
}

#[test]
fn what_is_written_is_what_is_read() {
    let folder = tempfile::tempdir().unwrap();
    let target = folder.path().join("simulated");
    let drive = small_drive().unwrap();
    let mut told = Vec::new();
    write_ece276a(&target, &drive, 30, false, &mut |unit, done, total| told.push((unit, done, total))).unwrap();
    let ended: Vec<_> =
        told.iter().filter(|(_, done, total)| done == total).map(|(unit, done, _)| (*unit, *done)).collect();
    let images = drive.disparity_stamps_s().len() + drive.color_stamps_s().len();
    assert_eq!(ended, [("scans", drive.scan_count()), ("images", images)]);

    let data = open(&target, &OpenOptions::default()).unwrap();
    assert_eq!((data.notes.len(), data.dropped.total()), (0, 0), "{:?}", data.notes);
    assert_eq!(&data.robot, &drive.config().robot);
    let expected = drive.records();
    assert_eq!(data.records.len(), expected.len());
    for (read, simulated) in data.records.iter().zip(&expected) {
        assert_eq!(read.stamp_s(), simulated.stamp_s());
        match (read, simulated) {
            (Record::Scan(a), Record::Scan(b)) => {
                assert_eq!(a.ranges_m, b.ranges_m);
                let angles = a.geometry.angles_rad.iter().zip(&b.geometry.angles_rad);
                assert!(angles.clone().all(|(a, b)| (a - b).abs() < 1e-12));
                assert_eq!(a.geometry.range_max_m, b.geometry.range_max_m);
            }
            (Record::Encoders(a), Record::Encoders(b)) => assert_eq!(a, b),
            (Record::Imu(a), Record::Imu(b)) => {
                assert_eq!(a.angular_velocity_rad_s, b.angular_velocity_rad_s);
                let forces = a.linear_acceleration_m_s2.iter().zip(b.linear_acceleration_m_s2);
                assert!(forces.into_iter().all(|(a, b)| (a - b).abs() < 1e-12));
            }
            (read, simulated) => panic!("{read:?} instead of {simulated:?}"),
        }
    }

    let images = data.images.unwrap();
    assert_eq!(images.depth.len(), drive.disparity_stamps_s().len());
    assert_eq!(images.depth[2].load_depth().unwrap(), drive.disparity_image(2).unwrap());
    assert_eq!(images.color[1].load_color().unwrap(), drive.color_image(1).unwrap());

    assert_eq!(read_trajectory(&target.join("truth.tum")).unwrap().len(), drive.scan_count());
    assert_eq!(read_map(&target.join("truth_map.yaml")).unwrap().cells, drive.true_map(0.05).cells);
    assert_eq!(read_floor(&target.join("truth_texture.json")).unwrap().cells, drive.true_floor(0.01).cells);
}

#[test]
fn an_earlier_simulation_is_replaced_only_when_asked_to() {
    let folder = tempfile::tempdir().unwrap();
    let target = folder.path().join("simulated");
    let mut config = SimulationConfig::default();
    (config.lidar.beams, config.lidar.rate_hz, config.camera.rate_hz) = (11, 1.0, 0.0);
    let drive = simulate(World::named("loop", 1).unwrap(), config, 1).unwrap();
    let write = |replace| write_ece276a(&target, &drive, 20, replace, &mut |_, _, _| {});
    write(false).unwrap();
    assert!(write(false).unwrap_err().to_string().contains("--force"));
    write(true).unwrap();
    std::fs::remove_file(target.join("simulation.json")).unwrap();
    assert!(write(true).is_err(), "what is no simulation is never replaced");
}
