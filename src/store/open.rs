//! Opens a store at an address.

use super::place::Place;
use super::{Key, Store, StoreError};
use object_store::local::LocalFileSystem;
use render::atomic_file::{WriteError, create_dir};
use render::disk::sync_folder;
use std::io::ErrorKind;
use std::path::Path;
use std::sync::Arc;
use std::time::Duration;

/// Settings for opening a store.
#[derive(Clone)]
pub struct StoreOptions {
    /// Credentials and endpoints, under object_store's names in upper or lower case: `AWS_ACCESS_KEY_ID`,
    /// `AWS_ENDPOINT_URL`, `GOOGLE_SERVICE_ACCOUNT`, ... Settings of other stores are ignored.
    pub settings: Vec<(String, String)>,
    /// Time for which a call is repeated while the store is unavailable or busy.
    pub patience: Duration,
}

impl Default for StoreOptions {
    fn default() -> Self {
        Self { settings: Vec::new(), patience: Duration::from_secs(45) }
    }
}

impl std::fmt::Debug for StoreOptions {
    /// Prints the names of the settings without their values.
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let names = self.settings.iter().map(|(name, _)| name);
        f.debug_struct("StoreOptions")
            .field("settings", &names.collect::<Vec<_>>())
            .field("patience", &self.patience)
            .finish()
    }
}

impl Store {
    /// Opens a folder (created if absent), `file:///…`, or `s3://BUCKET/PREFIX` (`gs://`, `az://` with their features).
    pub fn open(address: &str, options: &StoreOptions) -> Result<Self, StoreError> {
        let folder = match address.split_once("://") {
            None => address,
            Some(("file", path)) => path,
            Some((scheme, rest)) => return Self::open_url(scheme, rest, options),
        };
        Self::open_folder(Path::new(folder), options.patience)
    }

    /// Opens a folder of any name, and creates it if it is absent.
    pub(super) fn open_folder(path: &Path, patience: Duration) -> Result<Self, StoreError> {
        let address = || path.display().to_string();
        let invalid = |reason: String| StoreError::Address { address: address(), reason };
        create_dir(path).map_err(|WriteError { source, .. }| match source.kind() {
            ErrorKind::AlreadyExists | ErrorKind::NotADirectory | ErrorKind::InvalidInput => {
                invalid(source.to_string())
            }
            // The address is right, but the disk is full, or its owner forbids writing.
            _ => StoreError::Call {
                what: "create",
                key: "the folder".to_owned(),
                store: address(),
                reason: source.to_string(),
                passing: false,
            },
        })?;
        let root = path.canonicalize().map_err(|e| invalid(e.to_string()))?;
        // The client fails on disks that do not sync folders; there, each file is synced after its put.
        // Another failure is met again by the first put.
        let syncs_folders = sync_folder(&root).unwrap_or(true);
        let objects = LocalFileSystem::new_with_prefix(&root)
            .map_err(|e| invalid(e.to_string()))?
            .with_fsync(syncs_folders);
        Ok(Self {
            objects: Arc::new(objects),
            prefix: Key::default(),
            name: address(),
            local: Some(Arc::new(
                Place::open(path, syncs_folders).map_err(|e| invalid(e.to_string()))?,
            )),
            is_oddly_named: root.to_str().is_none(),
            patience,
        })
    }

    fn open_url(scheme: &str, rest: &str, options: &StoreOptions) -> Result<Self, StoreError> {
        // The parts before an @ or after a ? or # may be secrets, which do not belong in an address.
        let shown = rest.split(['?', '#']).next().unwrap_or_default();
        let shown = shown.rsplit('@').next().unwrap_or_default();
        let name = format!("{scheme}://{}", shown.trim_end_matches('/'));
        let invalid = |reason: String| StoreError::Address { address: name.clone(), reason };
        if rest.contains(['?', '#', '@']) {
            return Err(invalid(
                "credentials and settings belong in the environment (AWS_ACCESS_KEY_ID, …), not in an address"
                    .to_owned(),
            ));
        }
        let (bucket, prefix) = shown.split_once('/').unwrap_or((shown, ""));
        if bucket.is_empty() {
            return Err(invalid("it names no bucket".to_owned()));
        }
        let prefix = Key::parse(prefix).map_err(|e| invalid(e.to_string()))?;
        let objects = remote::open(scheme, &format!("{scheme}://{bucket}"), options);
        Ok(Self {
            objects: objects.map_err(invalid)?,
            prefix,
            name,
            local: None,
            is_oddly_named: false,
            patience: options.patience,
        })
    }
}

#[cfg(feature = "http-store")]
mod remote {
    use super::StoreOptions;
    use object_store::{BackoffConfig, ClientOptions, ObjectStore, RetryConfig};
    use std::sync::Arc;
    use std::time::Duration;

    /// Returns the settings of object_store's quick retries. [`super::super::patience`] handles longer outages, and
    /// calls that object_store does not repeat, such as a put over a lost connection.
    fn retries() -> RetryConfig {
        RetryConfig {
            backoff: BackoffConfig {
                init_backoff: Duration::from_millis(50),
                max_backoff: Duration::from_secs(1),
                base: 2.0,
            },
            max_retries: 3,
            retry_timeout: Duration::from_secs(8),
        }
    }

    /// Longest time of one request: a tuple of 40 MB over 10 Mbit/s takes 32 s.
    const REQUEST: Duration = Duration::from_mins(1);

    fn client() -> ClientOptions {
        let client = ClientOptions::new().with_timeout(REQUEST);
        client.with_user_agent(object_store::HeaderValue::from_static(concat!(
            "glasshouse/",
            env!("CARGO_PKG_VERSION")
        )))
    }

    /// Builds a store from the settings that the builder accepts.
    macro_rules! build {
        ($builder:ty, $url:expr, $options:expr) => {{
            let mut builder = <$builder>::new()
                .with_client_options(client())
                .with_retry(retries())
                .with_url($url);
            for (name, value) in &$options.settings {
                if let Ok(key) = name.to_ascii_lowercase().parse() {
                    builder = builder.with_config(key, value);
                }
            }
            // Errors of object_store contain only values that it cannot parse.
            builder
                .build()
                .map(|store| Arc::new(store) as Arc<dyn ObjectStore>)
                .map_err(|e| e.to_string())
        }};
    }

    /// Opens the store at `url`, if the feature of its scheme is enabled.
    pub(super) fn open(
        scheme: &str,
        url: &str,
        options: &StoreOptions,
    ) -> Result<Arc<dyn ObjectStore>, String> {
        // Without a TLS provider, the first connection panics. An earlier choice of a provider stays.
        let _ = rustls::crypto::ring::default_provider().install_default();
        let mut options = options.clone();
        // An endpoint that starts with http:// requests plain HTTP.
        let plain = options.settings.iter().any(|(name, value)| {
            name.to_ascii_lowercase().contains("endpoint") && value.starts_with("http://")
        });
        if plain {
            let allow = ("allow_http".to_owned(), "true".to_owned());
            options.settings.insert(0, allow);
        }
        match scheme {
            #[cfg(feature = "s3")]
            "s3" | "s3a" => build!(object_store::aws::AmazonS3Builder, url, options),
            #[cfg(feature = "gcs")]
            "gs" => build!(object_store::gcp::GoogleCloudStorageBuilder, url, options),
            #[cfg(feature = "azure")]
            "az" | "azure" | "abfs" | "abfss" => {
                build!(object_store::azure::MicrosoftAzureBuilder, url, options)
            }
            _ => Err(super::unknown(scheme)),
        }
    }
}

#[cfg(not(feature = "http-store"))]
mod remote {
    use super::StoreOptions;
    use object_store::ObjectStore;
    use std::sync::Arc;

    pub(super) fn open(
        scheme: &str,
        _: &str,
        _: &StoreOptions,
    ) -> Result<Arc<dyn ObjectStore>, String> {
        Err(super::unknown(scheme))
    }
}

fn unknown(scheme: &str) -> String {
    let feature = match scheme {
        "s3" | "s3a" => "s3",
        "gs" => "gcs",
        "az" | "azure" | "abfs" | "abfss" => "azure",
        _ => return format!("the scheme `{scheme}` is unknown"),
    };
    format!("this program was built without the feature `{feature}`")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn errors_contain_no_secrets() {
        for address in [
            "s3://AKIA:hush@bucket/x",
            "s3://bucket/x?secret=hush",
            "ftp://hush@x/y",
            "s3://bucket/x#hush",
        ] {
            let error = Store::open(address, &StoreOptions::default()).unwrap_err();
            assert!(matches!(error, StoreError::Address { .. }), "{error:?}");
            for text in [error.to_string(), format!("{error:?}")] {
                assert!(!text.contains("hush"), "{text}");
            }
        }
        let options = StoreOptions {
            settings: vec![("AWS_SECRET_ACCESS_KEY".to_owned(), "hush".to_owned())],
            ..StoreOptions::default()
        };
        assert!(!format!("{options:?}").contains("hush"));
    }

    #[test]
    fn invalid_addresses_are_refused() {
        for address in ["ftp://host/x", "memory://x", "s3://", "s3:///x"] {
            let error = Store::open(address, &StoreOptions::default()).unwrap_err();
            assert!(matches!(error, StoreError::Address { .. }), "{address}: {error:?}");
        }
    }

    #[cfg(feature = "s3")]
    #[test]
    fn opening_a_bucket_sends_no_request() {
        let settings = [
            ("AWS_ACCESS_KEY_ID", "a"),
            ("aws_secret_access_key", "hush"),
            ("AWS_ENDPOINT_URL", "http://127.0.0.1:1"),
            ("AWS_UNKNOWN", "x"),
            ("GOOGLE_APPLICATION_CREDENTIALS", "/x"),
        ];
        let options = StoreOptions {
            settings: settings.map(|(k, v)| (k.to_owned(), v.to_owned())).into(),
            patience: Duration::ZERO,
        };
        let store = Store::open("s3://bucket/runs/mine/", &options).unwrap();
        assert_eq!(store.name(), "s3://bucket/runs/mine");
        assert_eq!(store.local_root(), None);
        let error = store.get("spec.json").unwrap_err();
        assert!(error.is_passing(), "{error:?}");
        let text = format!("{error} {error:?} {store:?}");
        assert!(text.contains("spec.json in s3://bucket/runs/mine"), "{text}");
        assert!(!text.contains("hush"), "{text}");
    }
}
