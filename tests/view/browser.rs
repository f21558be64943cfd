//! A browser that shows the page, and the actions of a person in it.

use std::io::{BufRead, BufReader};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use serde_json::{Value, json};
use thirtyfour::prelude::*;
use thirtyfour::{ChromiumLikeCapabilities, LoggingPrefsLogLevel};

use crate::program::{Program, SIZE};

/// Nothing on the page takes longer than this, even where the renderer and the browser share two cores.
const PATIENCE: Duration = Duration::from_secs(20);
const GLANCE: Duration = Duration::from_millis(50);
/// Starts of chromedriver until one finds a port that no other program has.
const STARTS: usize = 20;

/// Runs a test in a browser whose tab shows `url`. Returns false, with a message, where there is no browser.
pub fn visit<F, T>(url: &str, test: F) -> bool
where
    F: FnOnce(Page) -> T,
    T: Future<Output = ()> + Send + 'static,
{
    let Some(driver) = Driver::start() else { return false };
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build().unwrap();
    let result = runtime.block_on(async {
        let browser = WebDriver::new(format!("http://127.0.0.1:{}", driver.port), capabilities()).await.unwrap();
        browser.goto(url).await.unwrap();
        let page = Page { browser: browser.clone() };
        let result = tokio::spawn(test(page)).await;
        // Without this, the browser would keep running.
        let _ = browser.quit().await;
        result
    });
    if let Err(failure) = result {
        std::panic::resume_unwind(failure.into_panic());
    }
    true
}

fn capabilities() -> impl Into<thirtyfour::Capabilities> {
    let mut wanted = DesiredCapabilities::chrome();
    let switches = [
        "--headless",
        "--no-sandbox",
        "--disable-dev-shm-usage",
        // WebGL2 without a graphics card.
        "--use-angle=swiftshader",
        "--enable-unsafe-swiftshader",
        "--force-device-scale-factor=1",
        "--window-size=1280,900",
        "--hide-scrollbars",
        "--no-first-run",
        "--disable-background-networking",
        "--disable-component-update",
        "--disable-sync",
        "--disable-extensions",
    ];
    for switch in switches {
        wanted.add_arg(switch).unwrap();
    }
    wanted.set_browser_log_level(LoggingPrefsLogLevel::All).unwrap();
    wanted
}

/// A running chromedriver. It ends when it is dropped.
struct Driver {
    process: Child,
    port: u16,
}

impl Driver {
    /// `None`, with a message, if chromium or chromedriver is absent.
    fn start() -> Option<Driver> {
        let is_there =
            |name: &str| std::env::split_paths(&std::env::var_os("PATH")?).map(|f| f.join(name)).find(|f| f.is_file());
        if let Some(name) = ["chromium", "chromedriver"].into_iter().find(|name| is_there(name).is_none()) {
            eprintln!("skipped: there is no {name}; on Debian, apt-get install chromium chromium-driver");
            return None;
        }
        let driver = (0..STARTS).find_map(|_| Driver::start_on_a_free_port());
        Some(driver.expect("chromedriver starts and prints its port"))
    }

    /// `None` if chromedriver ends before it serves. It takes a port that is free in IPv6, and ends if that port is taken in IPv4.
    fn start_on_a_free_port() -> Option<Driver> {
        let mut process = Command::new("chromedriver")
            .arg("--port=0")
            .stdout(Stdio::piped())
            .stderr(Stdio::null())
            .spawn()
            .expect("chromedriver starts");
        let mut lines = BufReader::new(process.stdout.take().unwrap()).lines();
        let port = lines
            .find_map(|line| line.ok()?.trim_end_matches('.').rsplit_once("successfully on port ")?.1.parse().ok());
        let Some(port) = port else {
            process.wait().expect("chromedriver ends");
            return None;
        };
        // Reads the later output, so that chromedriver never waits for a full pipe.
        std::thread::spawn(move || lines.for_each(drop));
        Some(Driver { process, port })
    }
}

impl Drop for Driver {
    fn drop(&mut self) {
        let _ = self.process.kill();
        let _ = self.process.wait();
    }
}

/// The page in the current tab.
#[derive(Clone)]
pub struct Page {
    pub browser: WebDriver,
}

impl Page {
    pub async fn find(&self, css: &str) -> WebElement {
        self.browser.find(By::Css(css)).await.unwrap_or_else(|e| panic!("{css}: {e}"))
    }

    pub async fn click(&self, css: &str) {
        self.find(css).await.click().await.unwrap_or_else(|e| panic!("{css}: {e}"));
    }

    pub async fn text(&self, css: &str) -> String {
        self.find(css).await.text().await.unwrap()
    }

    pub async fn value(&self, css: &str) -> String {
        self.find(css).await.prop("value").await.unwrap().unwrap_or_default()
    }

    /// Replaces the text of a field and presses Enter.
    pub async fn enter(&self, css: &str, text: &str) {
        self.find(css).await.send_keys(Key::Control + "a").await.unwrap();
        self.find(css).await.send_keys(text.to_string() + Key::Enter).await.unwrap();
    }

    pub async fn run(&self, script: &str) -> Value {
        self.browser.execute(script, vec![]).await.unwrap_or_else(|e| panic!("{script}: {e}")).json().clone()
    }

    /// Waits until a JavaScript expression is true.
    pub async fn until(&self, condition: &str) {
        self.until_within(PATIENCE, condition).await;
    }

    pub async fn until_within(&self, patience: Duration, condition: &str) {
        let start = Instant::now();
        while self.run(&format!("return !!({condition})")).await != json!(true) {
            if start.elapsed() > patience {
                let text = self.run("return document.body.innerText").await;
                panic!("this does not become true: {condition}\n{}", text.as_str().unwrap_or_default());
            }
            tokio::time::sleep(GLANCE).await;
        }
    }

    /// Number of the settings that the picture on the screen belongs to; 0 without a picture.
    pub async fn revision(&self) -> u64 {
        self.run("return Number(document.getElementById('picture').dataset.revision ?? 0)").await.as_u64().unwrap()
    }

    /// Waits for a picture of the whole image with at least this many samples per pixel, of later settings than `after`.
    pub async fn picture_after(&self, after: u64, samples: u32) {
        self.until(&format!(
            "(d => d.revision > {after} && d.size === '{SIZE}x{SIZE}' && d.samples >= {samples})(document.getElementById('picture').dataset)"
        ))
        .await;
    }

    /// Pauses, and waits until the picture on the screen is the last one.
    pub async fn pause(&self) {
        self.click("#pause").await;
        self.until("document.getElementById('phase').textContent === 'Paused'").await;
        self.until("document.getElementById('picture').dataset.samples === document.getElementById('samples').textContent.split(' ')[0]")
            .await;
    }

    pub async fn go_on(&self) {
        self.click("#pause").await;
        self.until("document.getElementById('phase').textContent !== 'Paused'").await;
    }

    /// Saves the image as an EXR file. Returns its path.
    pub async fn save(&self, program: &Program, name: &str) -> std::path::PathBuf {
        self.enter("#save-name", name).await;
        self.until(&format!("document.getElementById('saved').textContent.includes('{name}.exr')")).await;
        program.file(&format!("{name}.exr"))
    }

    /// Presses the left button at a point of an element, given from its centre, moves it, and releases it.
    pub async fn drag(&self, css: &str, from: (i64, i64), by: (i64, i64)) {
        let element = self.find(css).await;
        let mut chain = self.browser.action_chain_with_delay(None, Some(Duration::from_millis(20)));
        chain = chain.move_to_element_with_offset(&element, from.0, from.1).click_and_hold();
        let steps = 8;
        let part = |whole: i64, k: i64| whole * (k + 1) / steps - whole * k / steps;
        for k in 0..steps {
            chain = chain.move_by_offset(part(by.0, k), part(by.1, k));
        }
        chain.release().perform().await.unwrap();
    }

    /// Fails if the browser's console has a message.
    pub async fn says_nothing(&self) {
        let log = self.browser.browser_log().await.unwrap();
        let messages: Vec<&String> = log.iter().map(|entry| &entry.message).collect();
        assert!(messages.is_empty(), "the console has messages: {messages:?}");
    }

    /// The image on the screen as 8-bit R, G, B. One pixel of the image is one pixel of the screen.
    pub async fn screen(&self) -> Vec<u8> {
        self.click("#zoom-one").await;
        self.shot().await
    }

    /// The same without a click that draws the image again.
    pub async fn shot(&self) -> Vec<u8> {
        // After two frames of the screen, everything is drawn.
        self.browser
            .execute_async("requestAnimationFrame(() => requestAnimationFrame(arguments[0]))", vec![])
            .await
            .unwrap();
        let shot = self.find("#picture").await.screenshot_as_png().await.unwrap();
        let mut reader = png::Decoder::new(std::io::Cursor::new(shot)).read_info().unwrap();
        let mut bytes = vec![0; reader.output_buffer_size().unwrap()];
        let info = reader.next_frame(&mut bytes).unwrap();
        let channels = info.color_type.samples();
        let [left, top] =
            [info.width, info.height].map(|size| ((f64::from(size) - f64::from(SIZE)) / 2.0).round() as u32);
        let mut rgb = vec![];
        for y in 0..SIZE {
            for x in 0..SIZE {
                let at = channels * ((top + y) * info.width + left + x) as usize;
                rgb.extend_from_slice(&bytes[at..at + 3]);
            }
        }
        rgb
    }
}
