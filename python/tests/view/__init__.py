"""Tests that use the page of `taugate view` as a person does: in a real browser.

The browser is Debian's `chromium`, which `chromedriver` drives. Where one of them is absent, the tests are skipped. They need the
built program (target/release/taugate, or the one that TAUGATE_PROGRAM names) and a Vulkan device, but not the Python module.

Environment variables switch on further tests. TAUGATE_AXE names the file `axe.min.js` of axe-core, for the check of accessibility.
TAUGATE_ALONE=1 measures how soon the page shows a change, on a machine that does nothing else. TAUGATE_PICTURES names a folder for
the pictures of README and guide.
"""
