//! Compares the closed forms of the pane with a ray followed through its two faces, and with published values.

use crate::optics::Pane;
use glam::DVec3;
use render::trace::{Order, Slab};

/// Returns the distance between the lines through `a` and `b` with the direction `d`.
fn line_distance(a: DVec3, b: DVec3, d: DVec3) -> f64 {
    d.cross(a - b).length() / d.length()
}

#[test]
fn orders_match_a_ray_followed_face_by_face() {
    const ORDERS: u32 = 6;
    let (mut line, mut direction, mut weight, mut tested) = (0f64, 0f64, 0f64, 0);
    for incidence in [0.0, 1e-6, 5.0, 20.0, 45.0, 57.994617, 70.0, 80.0, 85.0, 89.9] {
        for ior in [1.0, 1.0003, 1.33, 1.6, 2.4] {
            for thickness_m in [0.0, 1e-3, 0.01, 0.1] {
                for absorption in [[0.0; 3], [0.0, 1.0, 5.0]] {
                    for (turn, tilt) in
                        [[0.0, 0.0], [12.0, 0.0], [0.0, -12.0], [30.0, -20.0], [-60.0, 10.0]]
                            .into_iter()
                            .enumerate()
                    {
                        let normal = Slab::tilted_normal(tilt);
                        let slab = Slab {
                            normal,
                            plane_distance_m: 0.3 * normal.z,
                            thickness_m,
                            ior,
                            absorption_per_m: absorption,
                        };
                        let pane = Pane {
                            normal,
                            distance_m: 0.3 * normal.z,
                            thickness_m,
                            ior,
                            absorption_per_m: absorption,
                        };
                        let side =
                            normal.cross(DVec3::new(0.1, 1.0, 0.2 * turn as f64)).normalize();
                        let angle = f64::to_radians(incidence);
                        let d = angle.cos() * normal + angle.sin() * side;
                        let origin = DVec3::new(0.004, -0.007, 0.0);
                        let cos_i = d.dot(normal);
                        let gamma = slab.gamma(cos_i);
                        let [transmitted, reflected] = pane.follow(origin, d, ORDERS as usize);
                        // Mirrored in the front face, a reflected ray continues along d.
                        let unfold =
                            |x: DVec3| x - 2.0 * (x.dot(normal) - pane.distance_m) * normal;
                        for k in 0..ORDERS {
                            for (order, exit, point) in [
                                (
                                    Order::Transmitted(k),
                                    &transmitted[k as usize],
                                    transmitted[k as usize].point,
                                ),
                                (
                                    Order::Reflected(k),
                                    &reflected[k as usize],
                                    unfold(reflected[k as usize].point),
                                ),
                            ] {
                                let out = match order {
                                    Order::Transmitted(_) => d,
                                    Order::Reflected(_) => d - 2.0 * cos_i * normal,
                                };
                                direction = direction.max((exit.direction - out).length());
                                let shifted = origin + slab.kappa_m(order, gamma) * normal;
                                let size = point.length().max(1.0);
                                line = line.max(line_distance(point, shifted, d) / size);
                                let computed = slab.weight(order, cos_i);
                                for (a, b) in computed.into_iter().zip(exit.weight()) {
                                    weight = weight.max((a - b).abs());
                                }
                                tested += 1;
                            }
                        }
                    }
                }
            }
        }
    }
    println!("{tested} orders: line {line:.1e} m, direction {direction:.1e}, weight {weight:.1e}");
    // At 89.9 degrees a cosine of 1.7e-3 loses three digits.
    assert!(line < 1e-11 && direction < 1e-10 && weight < 1e-10);
}

fn plain(ior: f64) -> Slab {
    Slab {
        normal: DVec3::Z,
        plane_distance_m: 0.3,
        thickness_m: 0.01,
        ior,
        absorption_per_m: [0.0, 5.0, 50.0],
    }
}

#[test]
fn orders_add_up_to_their_closed_totals() {
    let mut worst = 0f64;
    let mut lossless = 0f64;
    for ior in [1.0, 1.2, 1.6, 2.4] {
        let slab = plain(ior);
        for degrees in [0.0, 10.0, 30.0, 57.0, 75.0, 80.0, 85.0, 89.0] {
            let cos_i = f64::to_radians(degrees).cos();
            let sum = |order: fn(u32) -> Order| {
                let mut sum = [0.0; 3];
                for k in 0..2000 {
                    for (sum, w) in sum.iter_mut().zip(slab.weight(order(k), cos_i)) {
                        *sum += w;
                    }
                }
                sum
            };
            let (t, r) = (sum(Order::Transmitted), sum(Order::Reflected));
            for c in 0..3 {
                worst = worst.max((t[c] - slab.total_transmittance(cos_i)[c]).abs());
                worst = worst.max((r[c] - slab.total_reflectance(cos_i)[c]).abs());
            }
            lossless = lossless.max((t[0] + r[0] - 1.0).abs());
            assert!(t[2] + r[2] <= t[1] + r[1] && t[1] + r[1] <= t[0] + r[0] + 1e-12);
        }
    }
    println!("closed totals {worst:.1e}, lossless sum {lossless:.1e}");
    assert!(worst < 1e-12 && lossless < 1e-12);
}

/// Compares reflectances, weights, totals and gamma with published values and formulas at n = 1.6.
#[test]
fn weights_match_the_published_table() {
    let slab = plain(1.6);
    let at = |degrees: f64| f64::to_radians(degrees).cos();
    let weight = |order, degrees| slab.weight(order, at(degrees))[0];
    let near = |computed: f64, expected: f64| {
        assert!(
            (computed - expected).abs() <= 1e-9 * expected.abs() + 1e-14,
            "{computed} is not {expected}"
        );
    };
    let [r_s, r_p] = slab.reflectance(at(89.9));
    assert!((r_s - 0.994_426_07).abs() < 1e-8 && (r_p - 0.985_792_66).abs() < 1e-8);
    near(weight(Order::Reflected(0), 89.9), 0.990_109_365_7);
    near(weight(Order::Transmitted(0), 89.9), 1.164_585_820e-4);
    near(weight(Order::Transmitted(1), 89.9), 1.134_385_318e-4);
    near(weight(Order::Reflected(1), 89.9), 1.149_381_299e-4);
    near(slab.total_transmittance(at(89.9))[0], 4.974_623_157e-3);
    near(slab.total_reflectance(at(89.9))[0], 0.995_025_376_8);
    near(slab.gamma(at(89.9)), 1.397_379_681e-3);
    for (degrees, t, r_1) in [
        (85.0, 0.241_995_033_8, 0.086_549_225_4),
        (80.0, 0.448_700_977_8, 0.120_098_220_8),
        (60.0, 0.825_924_819_9, 0.065_819_054_67),
        (30.0, 0.896_511_133_4, 0.048_334_181_9),
    ] {
        near(slab.total_transmittance(at(degrees))[0], t);
        near(weight(Order::Reflected(1), degrees), r_1);
    }
    let brewster = 1.6f64.atan().cos();
    let [r_s, r_p] = slab.reflectance(brewster);
    assert!(r_p < 1e-30 && (r_s - 0.192_021_209_4).abs() < 1e-10);
    near(slab.total_transmittance(brewster)[0], 0.838_911_247_6);
    near(slab.gamma(brewster), 0.390_625);
    let r = (0.6f64 / 2.6).powi(2);
    near(weight(Order::Transmitted(0), 0.0), (1.0 - r) * (1.0 - r));
    near(slab.total_transmittance(1.0)[0], (1.0 - r) / (1.0 + r));
}

#[test]
fn absorbing_totals_equal_the_sums_of_the_series() {
    let slab = plain(1.6);
    for degrees in [0.0, 40.0, 75.0] {
        let cos_i = f64::to_radians(degrees).cos();
        let sin_t = f64::to_radians(degrees).sin() / 1.6;
        let tau = (-0.01 * 5.0 / (1.0 - sin_t * sin_t).sqrt()).exp();
        let r = slab.reflectance(cos_i);
        let mean = |f: &dyn Fn(f64) -> f64| 0.5 * (f(r[0]) + f(r[1]));
        let t = mean(&|r| (1.0 - r).powi(2) * tau / (1.0 - r * r * tau * tau));
        let back = mean(&|r| r + (1.0 - r).powi(2) * r * tau * tau / (1.0 - r * r * tau * tau));
        assert!((slab.total_transmittance(cos_i)[1] - t).abs() < 1e-14);
        assert!((slab.total_reflectance(cos_i)[1] - back).abs() < 1e-14);
    }
}

#[test]
fn tilt_is_right_handed_about_x_then_y() {
    let yawed = Slab::tilted_normal([0.0, 30.0]);
    assert!((yawed - DVec3::new(0.5, 0.0, 0.75f64.sqrt())).length() < 1e-15);
    let pitched = Slab::tilted_normal([30.0, 0.0]);
    assert!((pitched - DVec3::new(0.0, -0.5, 0.75f64.sqrt())).length() < 1e-15);
    let both = Slab::tilted_normal([30.0, 90.0]);
    assert!((both - DVec3::new(0.75f64.sqrt(), -0.5, 0.0)).length() < 1e-15);
}
