//! After the camera was turned on the page, the command on the page has the same camera.

use std::time::Duration;

use thirtyfour::prelude::*;

use crate::browser::visit;
use crate::program::{Program, agree, render};

/// JavaScript for the elevation of the camera in degrees. It looks at a point 1 m above the ground.
const ELEVATION: &str = "(([x, y, z]) => 180 / Math.PI * Math.atan2(y - 1, Math.hypot(x, z)))\
                         (document.getElementById('look-from').value.split(','))";
/// After this time without a movement, the page follows the camera of the program.
const SETTLED: Duration = Duration::from_millis(700);

#[test]
fn the_camera_is_turned_moved_and_reset() {
    let program = Program::start(&["--gate", "6.2m..6.5m"]);
    visit(&program.url.clone(), async move |page| {
        page.picture_after(0, 1).await;
        let start = page.value("#look-from").await;
        let before = page.revision().await;
        page.drag("#stage", (0, 0), (60, 20)).await;
        page.picture_after(before, 1).await;
        page.until("document.getElementById('command').textContent.includes('--look-from')").await;
        let turned = page.value("#look-from").await;
        let [x, y, _] = numbers(&turned);
        assert!(
            x < -0.5 && y > 1.1,
            "{turned}: a drag to the right moves the camera to the left, a drag downwards moves it up"
        );

        // Waits for the full image, which comes after the previews.
        let before = page.revision().await - 1;
        page.picture_after(before, 32).await;
        page.pause().await;
        let saved = page.save(&program, "turned").await;
        let command = page.run("return document.getElementById('command').textContent").await;
        // Removes the quotes, as a shell does.
        let words: Vec<String> =
            command.as_str().unwrap().split_whitespace().map(|word| word.replace('\'', "")).collect();
        let end = words.iter().position(|word| word == "--spp").unwrap();
        let (_folder, reference) = render(&words[1..end]);
        assert!(agree(&saved, &reference), "the picture is not that of {command}");
        page.go_on().await;

        page.find("#stage").await.send_keys("r").await.unwrap();
        page.until(&format!("document.getElementById('look-from').value === '{start}'")).await;
        page.until("!document.getElementById('command').textContent.includes('--look-from')").await;

        // Above 60 degrees, and at the largest elevation, the camera does not roll.
        page.drag("#stage", (0, -150), (0, 190)).await;
        page.until(&format!("Math.abs({ELEVATION} - 65.3) < 1")).await;
        tokio::time::sleep(SETTLED).await;
        let before = page.run(&format!("return {ELEVATION}")).await.as_f64().unwrap();
        page.drag("#stage", (-60, 0), (100, 0)).await;
        page.until("document.getElementById('look-from').value.split(',')[0] < -0.5").await;
        tokio::time::sleep(SETTLED).await;
        let after = page.run(&format!("return {ELEVATION}")).await.as_f64().unwrap();
        assert!((before - after).abs() < 0.1, "{before} and {after} degrees");
        page.drag("#stage", (0, -150), (0, 300)).await;
        page.until(&format!("Math.abs({ELEVATION} - 88.85) < 0.1")).await;
        let command = page.run("return document.getElementById('command').textContent").await;
        assert!(!command.as_str().unwrap().contains("--up"), "{command}");
        page.find("#stage").await.send_keys("r").await.unwrap();
        page.until(&format!("document.getElementById('look-from').value === '{start}'")).await;

        // Flying forwards, then closer with the wheel's keys.
        page.find("#stage").await.send_keys("www").await.unwrap();
        page.until("document.getElementById('look-from').value.split(',')[2] < 3.9").await;
        let flown = numbers(&page.value("#look-from").await)[2];
        page.find("#stage").await.send_keys("" + Key::PageUp).await.unwrap();
        page.until(&format!("document.getElementById('look-from').value.split(',')[2] < {flown} - 0.1")).await;

        // Settings beside the picture.
        page.enter("#look-from", "0 1 3.5").await;
        page.enter("#max-depth", "5").await;
        page.find("#estimator").await.send_keys("bdpt").await.unwrap();
        page.until("/--look-from '0.0,1.0,3.5'.*--estimator bdpt.*--max-depth 5/.test(document.getElementById('command').textContent)").await;
        page.enter("#max-depth", "-5").await;
        page.until("document.querySelector('.alert.problem')?.textContent.includes('max-depth')").await;
        page.until("document.getElementById('max-depth').value === '5'").await;
        page.says_nothing().await;
    });
}

fn numbers(text: &str) -> [f64; 3] {
    let numbers: Vec<f64> = text.split(',').map(|number| number.parse().unwrap()).collect();
    numbers.try_into().unwrap()
}
