//! A Firefox that shows one page, whose script tells what it found by a request to the test.

use super::*;
use std::net::TcpListener;

/// No first steps, and no network but this machine.
const PREFERENCES: &str = r#"
user_pref("browser.aboutwelcome.enabled", false);
user_pref("browser.shell.checkDefaultBrowser", false);
user_pref("browser.startup.homepage_override.mstone", "ignore");
user_pref("datareporting.policy.dataSubmissionEnabled", false);
user_pref("network.captive-portal-service.enabled", false);
user_pref("network.connectivity-service.enabled", false);
user_pref("network.proxy.type", 1);
user_pref("network.proxy.http", "127.0.0.1");
user_pref("network.proxy.http_port", 9);
user_pref("network.proxy.ssl", "127.0.0.1");
user_pref("network.proxy.ssl_port", 9);
user_pref("webgl.force-enabled", true);
"#;

/// What the page tells its findings to.
pub(super) struct Ear(TcpListener);

impl Ear {
    pub(super) fn open() -> Self {
        Self(TcpListener::bind("127.0.0.1:0").unwrap())
    }

    pub(super) fn address(&self) -> String {
        format!("http://{}/", self.0.local_addr().unwrap())
    }

    /// Opens a page, and waits for what it tells.
    pub(super) fn told_by(&self, browser: &Path, page: &str) -> Value {
        let profile = tempfile::tempdir().unwrap();
        fs::write(profile.path().join("user.js"), PREFERENCES).unwrap();
        let mut child = Command::new(browser)
            .args(["--no-remote", "--new-instance", "--width", "900", "--height", "800", "--profile"])
            .arg(profile.path())
            .arg(page)
            .stdout(Stdio::null())
            .stderr(Stdio::null())
            .spawn()
            .unwrap();
        let (mut client, _) = self.0.accept().unwrap();
        let (mut bytes, mut some) = (Vec::new(), [0; 65536]);
        let body = loop {
            let count = client.read(&mut some).unwrap();
            assert!(count > 0, "the page was cut short");
            bytes.extend_from_slice(&some[..count]);
            let Some(end) = bytes.windows(4).position(|four| four == b"\r\n\r\n") else { continue };
            let head = String::from_utf8_lossy(&bytes[..end]).to_lowercase();
            let length = head.split("content-length: ").nth(1).unwrap();
            let length: usize = length.split("\r\n").next().unwrap().trim().parse().unwrap();
            if bytes.len() >= end + 4 + length {
                break bytes.split_off(end + 4);
            }
        };
        let _ = client.write_all(b"HTTP/1.1 204 No Content\r\n\r\n");
        let _ = child.kill();
        let _ = child.wait();
        serde_json::from_slice(&body).unwrap()
    }
}
