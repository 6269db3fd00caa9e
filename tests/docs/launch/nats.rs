//! The key script makes keys for the queue's server, and the shipped configuration requires TLS and a key.

use super::launch;
use crate::support::nats::SecureNats;
use crate::support::tools::{content, make_keys, tool};
use std::io::{BufRead, BufReader};
use std::net::TcpStream;
use std::os::unix::fs::PermissionsExt;
use std::path::Path;
use std::process::Command;
use std::time::Duration;

const ROLES: [&str; 3] = ["coordinator", "worker", "observer"];

fn read(folder: &Path, name: &str) -> String {
    std::fs::read_to_string(folder.join("keys").join(name)).unwrap()
}

/// Decodes unpadded base32 (RFC 4648).
fn base32(text: &str) -> Vec<u8> {
    let (mut bytes, mut bits, mut have) = (Vec::new(), 0_u32, 0);
    for letter in text.bytes() {
        let digit = match letter {
            b'A'..=b'Z' => letter - b'A',
            b'2'..=b'7' => letter - b'2' + 26,
            _ => panic!("{letter} in {text}"),
        };
        bits = (bits << 5) | u32::from(digit);
        have += 5;
        if have >= 8 {
            have -= 8;
            bytes.push((bits >> have) as u8);
            bits &= (1 << have) - 1;
        }
    }
    bytes
}

/// Computes CRC-16/XMODEM, the checksum of nkeys.
fn crc16(bytes: &[u8]) -> u16 {
    bytes.iter().fold(0, |crc, byte| {
        (0..8).fold(crc ^ (u16::from(*byte) << 8), |crc, _| {
            (crc << 1) ^ if crc & 0x8000 == 0 { 0 } else { 0x1021 }
        })
    })
}

/// Decodes an nkey to its prefix and key, and checks its checksum.
fn nkey(text: &str, prefix: usize) -> (Vec<u8>, Vec<u8>) {
    let bytes = base32(text.trim());
    assert_eq!(bytes.len(), prefix + 32 + 2, "{text}");
    let (body, sum) = bytes.split_at(prefix + 32);
    assert_eq!(crc16(body), u16::from_le_bytes([sum[0], sum[1]]), "{text}");
    (body[..prefix].to_owned(), body[prefix..].to_owned())
}

#[test]
fn crc16_and_base32_match_published_values() {
    assert_eq!(crc16(b"123456789"), 0x31c3);
    assert_eq!(base32("MZXW6YTBOI"), b"foobar");
}

#[test]
fn each_role_has_its_own_key() {
    let folder = tempfile::tempdir().unwrap();
    if make_keys(&folder.path().join("keys"), &["localhost", "127.0.0.1"]).is_none() {
        return;
    }
    let mut seen = Vec::new();
    for role in ROLES {
        let seed = read(folder.path(), &format!("{role}/nkey"));
        let public = read(folder.path(), &format!("{role}/nkey.pub"));
        assert!(seed.starts_with("SU") && public.starts_with('U'));
        let (prefix, seed) = nkey(&seed, 2);
        assert_eq!(prefix, [(18 << 3) | (20 >> 2), 0]);
        let (prefix, public) = nkey(&public, 1);
        assert_eq!(prefix, [20 << 3]);
        // Seed and public key match: openssl derives the same public key from the seed.
        let der = folder.path().join("seed.der");
        let head = b"\x30\x2e\x02\x01\x00\x30\x05\x06\x03\x2b\x65\x70\x04\x22\x04\x20";
        std::fs::write(&der, [head.as_slice(), &seed].concat()).unwrap();
        let mut command = Command::new("openssl");
        command.args(["pkey", "-inform", "DER", "-pubout", "-outform", "DER", "-in"]);
        let made = tool(command.arg(&der)).unwrap();
        content(&made);
        assert!(made.stdout.ends_with(&public), "{role}");
        let environment = read(folder.path(), &format!("{role}/queue.env"));
        assert!(environment.contains("GLASSHOUSE_QUEUE=tls://localhost:4222\n"));
        assert!(
            read(folder.path(), "server/keys.conf")
                .contains(&format!("{}_NKEY: ", role.to_uppercase()))
        );
        seen.extend([seed, public]);
    }
    seen.sort();
    seen.dedup();
    assert_eq!(seen.len(), 2 * ROLES.len());
}

#[test]
fn only_the_owner_can_read_keys() {
    let folder = tempfile::tempdir().unwrap();
    if make_keys(&folder.path().join("keys"), &["localhost"]).is_none() {
        return;
    }
    let keys = folder.path().join("keys");
    for entry in std::fs::read_dir(&keys).unwrap() {
        let role = entry.unwrap().path();
        for entry in std::fs::read_dir(&role).unwrap() {
            let path = entry.unwrap().path();
            let mode = path.metadata().unwrap().permissions().mode();
            assert_eq!(mode & 0o077, 0, "{}", path.display());
        }
        assert_eq!(role.metadata().unwrap().permissions().mode() & 0o077, 0);
    }
    // The roles' folders have neither the authority's key nor temporary files of openssl.
    for role in ROLES {
        let files = std::fs::read_dir(keys.join(role)).unwrap();
        let mut names: Vec<_> = files.map(|f| f.unwrap().file_name()).collect();
        names.sort();
        assert_eq!(names, ["ca.pem", "nkey", "nkey.pub", "queue.env"]);
    }
}

#[test]
fn existing_keys_are_kept_and_missing_keys_are_made() {
    let folder = tempfile::tempdir().unwrap();
    if make_keys(&folder.path().join("keys"), &["localhost"]).is_none() {
        return;
    }
    let all = || {
        let names = ["ca/ca.pem", "server/cert.pem", "worker/nkey", "observer/nkey"];
        names.map(|name| read(folder.path(), name))
    };
    let first = all();
    make_keys(&folder.path().join("keys"), &["localhost"]).unwrap();
    assert_eq!(all(), first);
    // The test deletes a key and renames the server.
    std::fs::remove_dir_all(folder.path().join("keys/worker")).unwrap();
    make_keys(&folder.path().join("keys"), &["queue.example", "::1"]).unwrap();
    let second = all();
    assert_eq!(second[0], first[0]);
    assert_ne!(second[1], first[1]);
    assert_ne!(second[2], first[2]);
    assert_eq!(second[3], first[3]);
    let keys = folder.path().join("keys");
    for (name, is_its) in [("queue.example", true), ("localhost", false)] {
        let mut command = Command::new("openssl");
        command.args(["verify", "-purpose", "sslserver", "-verify_hostname", name, "-CAfile"]);
        command.arg(keys.join("worker/ca.pem")).arg(keys.join("server/cert.pem"));
        assert_eq!(tool(&mut command).unwrap().status.success(), is_its, "{name}");
    }
}

#[test]
fn the_server_accepts_the_configuration_and_requires_tls_and_a_key() {
    let Some(server) = SecureNats::start() else {
        return;
    };
    let mut command = Command::new("nats-server");
    let configuration = server.key("server", "server.conf");
    content(&tool(command.arg("-t").arg("-c").arg(configuration)).unwrap());
    let stream = TcpStream::connect(("127.0.0.1", server.port)).unwrap();
    stream.set_read_timeout(Some(Duration::from_secs(10))).unwrap();
    let mut hello = String::new();
    BufReader::new(stream).read_line(&mut hello).unwrap();
    let hello: serde_json::Value =
        serde_json::from_str(hello.strip_prefix("INFO ").unwrap()).unwrap();
    for promise in ["tls_required", "auth_required", "jetstream"] {
        assert_eq!(hello[promise], true, "{promise} in {hello}");
    }
    assert!(hello["nonce"].is_string(), "{hello}");
}

/// A wildcard must be a whole token: the server takes `GLASSHOUSE_*` as a literal name that matches no subject.
#[test]
fn wildcards_stand_for_whole_tokens() {
    let text = std::fs::read_to_string(launch("nats/server.conf")).unwrap();
    let code = text.lines().map(|l| l.split(" #").next().unwrap());
    let subjects: Vec<&str> = code
        .flat_map(|line| line.split('"').skip(1).step_by(2))
        .filter(|s| s.contains('.') && s.contains(['*', '>']))
        .collect();
    assert!(subjects.len() > 10, "{subjects:?}");
    for subject in subjects {
        let subject = subject.split(' ').next().unwrap();
        for token in subject.split('.') {
            assert!(!token.contains(['*', '>']) || token.len() == 1, "{subject}");
        }
    }
}
