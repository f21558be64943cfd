use glam::DVec3;

use super::*;
use crate::generate::{Kind, build};
use crate::scene::Camera;
use crate::settings::units::Gate;
use crate::settings::{Estimator, UseEllipsoids};

/// Adds a second camera to the Cornell box, `offset` metres from the first. Prepares the scene for the first camera and
/// plans a render with the second.
fn seen_from(offset: DVec3) -> (PreparedScene, Camera, Result<Plan>) {
    let mut scene = build(Kind::CornellBox);
    let mut beside = Camera { name: "beside".into(), ..scene.cameras[0].clone() };
    beside.transform.translation += offset;
    scene.add_camera(beside.clone());
    let settings = |camera: usize| Settings::builder().camera(camera).build().unwrap();
    let prepared = PreparedScene::new(&scene, &settings(0)).unwrap();
    let plan = Plan::new(&scene, &settings(1), &prepared, Quirks::NONE);
    (prepared, beside, plan)
}

#[test]
fn the_sensor_stands_where_the_camera_does() {
    let (prepared, camera, plan) = seen_from(DVec3::new(0.1, 0.0, 0.0));
    let sensor = plan.unwrap().frame.sensor;
    assert_ne!(sensor, [0.0; 3]);
    assert_eq!(sensor, prepared.space.point(camera.transform.translation).to_array());
}

#[test]
fn a_camera_far_from_where_the_scene_was_prepared_for_is_refused() {
    let message = seen_from(DVec3::new(9.0, 0.0, 0.0)).2.err().expect("it is too far").to_string();
    assert!(message.contains("camera 'beside'"), "{message}");
}

#[test]
fn a_device_with_a_slow_compiler_forms_ellipsoidal_connections_on_request_only() {
    let scene = build(Kind::CornellBox);
    let thin = Gate { lo: 6.5, hi: 6.5001 };
    let slow = Quirks { slow_ellipsoids: true, ..Quirks::NONE };
    let has_ellipsoids = |wanted: UseEllipsoids, quirks: Quirks| {
        let settings = Settings::builder().estimator(Estimator::Lcs).gate(thin).ellipsoids(wanted).build().unwrap();
        let prepared = PreparedScene::new(&scene, &settings).unwrap();
        Plan::new(&scene, &settings, &prepared, quirks).unwrap().estimator.ellipsoids != Ellipsoids::None
    };
    assert!(has_ellipsoids(UseEllipsoids::Auto, Quirks::NONE) && !has_ellipsoids(UseEllipsoids::Auto, slow));
    assert!(has_ellipsoids(UseEllipsoids::On, slow));
}
