//! The camera that the page turns is that of the command that it shows.

use thirtyfour::prelude::*;

use crate::browser::visit;
use crate::program::{Program, agree, render};

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
