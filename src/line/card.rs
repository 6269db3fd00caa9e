//! Flat pictures with transparent parts between the pane and the surface of a side.

use super::image::Transfer;
use glasshouse_keys::keys;

/// A picture with transparent parts on a rectangle parallel to the film, such as the photographer behind the camera, or a
/// blind before the window. The side's surface is visible through it and beside it, and hides it where it is nearer.
///
/// A card of the front is upright for the camera: its column u in [0, 1] lies at world x = center_m\[0\] + (u - 1/2) width_m. A
/// card of the back faces the pane: column u lies at x = center_m\[0\] - (u - 1/2) width_m, so that its mirror image has the
/// columns from left to right again, mirrored. Row v lies at y = center_m\[1\] + (v - 1/2) height, with the proportions of the picture.
#[keys]
pub struct Card {
    /// Path of a picture with straight alpha: relative to the manifest, or `NAME:path` under a named root. PNG and `.npy`
    /// have alpha; other formats of colour images (except EXR) are opaque.
    pub color: String,
    /// Distance of the card's plane from the lens along the optical axis: before the lens for the front, behind it for the back.
    /// The whole card must lie on its side of the pane.
    // Single precision holds the squares of sizes and places of pictures in the scene.
    #[key("(0, 1e9] m")]
    pub distance_m: f64,
    /// World coordinates of the card's centre: right, down.
    #[key("[-1e9, 1e9] m")]
    pub center_m: [f64; 2],
    /// Width of the card; its height follows from the picture.
    #[key("(0, 1e9] m")]
    pub width_m: f64,
    /// Transfer function of the picture; alpha is linear.
    #[key(default = Transfer::Srgb, written)]
    pub transfer: Transfer,
    /// Factor on linear radiance.
    #[key("[0, inf)", default = 1.0)]
    pub exposure: f64,
    /// Factors on red, green and blue of linear radiance.
    #[key("[0, inf)", default = [1.0; 3])]
    pub illuminant: [f64; 3],
}

#[cfg(test)]
mod tests {
    use super::super::{SceneLine, Side, parse_scene, published, to_jsonl};

    fn with_cards(cards: &str) -> Result<SceneLine, String> {
        let mut line = published();
        let side = format!(r#"{{"panorama":"p","cards":[{cards}]}}"#);
        line.back = serde_json::from_str(&side).map_err(|error| error.to_string())?;
        line.validate().map_err(|error| error.to_string())?;
        Ok(line)
    }

    const CARD: &str = r#"{"color":"c.png","distance_m":0.25,"center_m":[-0.3,0.4],"width_m":0.5"#;

    #[test]
    fn cards_are_files_of_their_side() {
        let mut line = with_cards(&format!(r#"{CARD}}}, {CARD},"exposure":2}}"#)).unwrap();
        let paths: Vec<String> =
            line.back.paths().iter().map(|(key, path)| format!("{key} {path}")).collect();
        assert_eq!(paths, ["panorama p", "cards[0].color c.png", "cards[1].color c.png"]);
        for path in line.back.paths_mut() {
            path.insert_str(0, "root:");
        }
        assert_eq!(line.back.cards()[1].color, "root:c.png");
        // The camera's exposure applies to cards, but the light of the side does not.
        (line.camera.exposure, line.camera.white_balance) = (3.0, [1.0, 2.0, 1.0]);
        *line.back.light_mut().0 = 7.0;
        let seen = line.back.seen_by(&line.camera);
        assert_eq!((seen.cards()[1].exposure, seen.cards()[1].illuminant), (6.0, [1.0, 2.0, 1.0]));
        assert_eq!(seen.exposure(), 21.0);
        let text = to_jsonl(std::slice::from_ref(&line));
        assert_eq!(parse_scene(&text).unwrap(), line);
    }

    #[test]
    fn a_side_without_cards_keeps_its_text() {
        for side in [
            r#"{"panorama":"p"}"#,
            r#"{"mesh":"m"}"#,
            r#"{"color":"c","depth":"d","intrinsics":{"fx":1,"fy":1,"cx":0,"cy":0}}"#,
        ] {
            let side: Side = serde_json::from_str(side).unwrap();
            assert!(!serde_json::to_string(&side).unwrap().contains("cards"));
        }
    }

    #[test]
    fn errors_name_the_card_and_its_field() {
        let many = vec![format!("{CARD}}}"); 17].join(",");
        for (cards, message) in [
            (format!(r#"{CARD},"distance":1}}"#), "unknown field `distance`"),
            (r#"{"color":"c.png"}"#.to_owned(), "missing field `distance_m`"),
            (CARD.replace("0.25", "0") + "}", "back.cards[0].distance_m is 0, but must be above 0"),
            (CARD.replace("0.5", "-1") + "}", "back.cards[0].width_m is -1, but must be above 0"),
            (CARD.replace("0.5", "1e300") + "}", "width_m is 1e300"),
            (
                CARD.replace("-0.3", "-1e10") + "}",
                "center_m[0] is -10000000000, but must be -1e9 to",
            ),
            (CARD.replace("c.png", "") + "}", "back.cards[0].color is empty"),
            (many, "back.cards has 17 cards, but at most 16 are allowed"),
        ] {
            let error = with_cards(&cards).unwrap_err();
            assert!(error.contains(message), "{error} for {cards}");
        }
    }
}
