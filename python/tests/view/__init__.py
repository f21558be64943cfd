"""Tests that use the page of `taugate view` as a person does: in a real browser.

The browser is Debian's `chromium`, which `chromedriver` drives. Where one of them is absent, the tests are skipped. They need the
built program (target/release/taugate, or the one that TAUGATE_PROGRAM names) and a Vulkan device, but not the Python module.
"""
