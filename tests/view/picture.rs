//! The page shows the same image as the file that it saves. `taugate render` computes this image too, up to noise.

use crate::browser::visit;
use crate::program::{Program, SIZE, agree, pixels, render, words};

/// Exposure of the pictures in EV.
const STOPS: f32 = 3.0;

/// Multiplies linear values by `factor` and encodes them to sRGB bytes (IEC 61966-2-1).
fn expose(rgb: &[f32], factor: f32) -> Vec<u8> {
    let srgb = |x: f32| if x <= 0.003_130_8 { 12.92 * x } else { 1.055 * x.powf(1.0 / 2.4) - 0.055 };
    rgb.iter().map(|&x| (255.0 * srgb((x * factor).clamp(0.0, 1.0)) + 0.5) as u8).collect()
}

fn largest_difference(a: &[u8], b: &[u8]) -> u8 {
    a.iter().zip(b).map(|(a, b)| a.abs_diff(*b)).max().unwrap()
}

#[test]
fn the_screen_shows_what_is_saved_and_what_render_makes() {
    let program = Program::start(&["--gate", "6.2m..6.5m"]);
    visit(&program.url.clone(), async move |page| {
        page.picture_after(0, 32).await;
        assert_eq!(page.run("return document.getElementById('picture').dataset.painter").await, "WebGL2");
        page.enter("#stops", "3").await;
        page.pause().await;

        let saved = page.save(&program, "first").await;
        let expected = expose(&pixels(&saved), 2f32.powf(STOPS));
        let screen = page.screen().await;
        assert!(screen.iter().any(|&byte| byte > 100));
        assert!(largest_difference(&screen, &expected) <= 1, "the screen differs from the file");
        let dimmer = expose(&pixels(&saved), 2f32.powf(STOPS - 0.1));
        assert!(largest_difference(&screen, &dimmer) > 1);

        // The browser may lose the WebGL2 context and restore it.
        let lose = "const picture = document.getElementById('picture'), gl = picture.getContext('webgl2').getExtension('WEBGL_lose_context');
            picture.addEventListener('webglcontextlost', () => setTimeout(() => gl.restoreContext()), { once: true });
            picture.addEventListener('webglcontextrestored', () => arguments[0](), { once: true });
            gl.loseContext();";
        page.browser.execute_async(lose, vec![]).await.unwrap();
        assert!(largest_difference(&page.shot().await, &expected) <= 1, "the picture is not drawn again");

        let (_folder, reference) = render(&words(&["--gate", "6.2m..6.5m"]));
        assert!(agree(&saved, &reference), "the saved image is not that of taugate render");
        let (_folder, other) = render(&words(&["--gate", "6.3m..6.6m"]));
        assert!(!agree(&saved, &other), "the comparison would not notice a wrong gate");

        // The page refuses to overwrite a file, and says so.
        page.enter("#save-name", "first").await;
        page.until("document.querySelector('.alert.problem')?.textContent.includes('first.exr')").await;

        // The same picture without WebGL2.
        page.browser.goto(program.url.replace("/#", "/?2d#")).await.unwrap();
        page.picture_after(0, 8).await;
        assert_eq!(page.run("return document.getElementById('picture').dataset.painter").await, "2D canvas");
        page.enter("#stops", "3").await;
        assert!(largest_difference(&page.screen().await, &expected) <= 1, "the 2D canvas shows something else");

        let paused = page.run("return document.getElementById('picture').dataset.samples").await;
        page.go_on().await;
        page.until(&format!("document.getElementById('picture').dataset.samples > {}", paused.as_str().unwrap())).await;
        page.says_nothing().await;
    });
}

#[test]
fn pixels_have_values_and_errors() {
    let program = Program::start(&["--gate", "6.2m..6.5m"]);
    visit(&program.url.clone(), async move |page| {
        page.picture_after(0, 8).await;
        page.until("document.getElementById('relmse').textContent !== '–'").await;
        page.pause().await;
        let saved = page.save(&program, "values").await;
        page.click("#stage").await;
        page.until("document.getElementById('readout-place').textContent.startsWith('Held')").await;
        let place = page.text("#readout-place").await;
        let numbers: Vec<usize> =
            place.split(|c: char| !c.is_ascii_digit()).filter_map(|part| part.parse().ok()).collect();
        let [x, y] = numbers[..] else { panic!("{place}") };
        assert!(x.abs_diff(SIZE as usize / 2) <= 1 && y.abs_diff(SIZE as usize / 2) <= 1, "{place} is not the middle");
        page.until("document.getElementById('readout-radiance').textContent.includes('±')").await;
        let expected = pixels(&saved)[3 * (y * SIZE as usize + x)];
        let shown = page.text("#readout-radiance").await;
        let red: f32 = shown.trim_start_matches(['R', ' ', '(']).split(' ').next().unwrap().parse().unwrap();
        assert!((red - expected).abs() <= 0.05 * expected, "{shown}: {expected}");
        page.until("/depth [0-9.]+ m · [a-z]/.test(document.getElementById('readout-more').textContent)").await;

        // The picture of the error differs from the picture of the radiance.
        let radiance = page.screen().await;
        page.click("[value=error]").await;
        page.until("document.getElementById('picture').dataset.layer === 'error'").await;
        page.until("!document.getElementById('legend').hidden").await;
        assert!(largest_difference(&page.screen().await, &radiance) > 50);
        page.says_nothing().await;
    });
}
