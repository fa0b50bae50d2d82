//! A rollout as a strip of frames at equal times, seen from the right of its path, as SVG: what a card
//! shows of a gait.

use std::fmt::Write;

use vocaloco_core::robot::RobotModel;
use vocaloco_sim::{
    driver::TICK_S,
    kinematics::{forward_kinematics, legs},
    plant::Measurement,
    watched::Watched,
};

use super::shapes::base_boxes;

/// Pixels for a metre.
const SCALE: f32 = 200.0;
/// Width and height of a frame, m.
const FRAME_M: [f32; 2] = [1.6, 1.15];
/// Frames side by side before the next row.
const COLUMNS: usize = 4;
const GAP_PX: f32 = 8.0;
const TITLE_PX: f32 = 34.0;
/// How much of a frame lies below the base, m.
const BELOW_BASE_M: f32 = 0.8;
/// Where the feet walk, to the left and to the right of the path: the ground is drawn along both, m.
const LANES_M: [f32; 2] = [0.2, -0.2];
const PROFILE_EVERY_M: f32 = 0.01;
/// Diameter of thigh and shank, m.
const LIMB_M: [f32; 3] = [0.1, 0.08, 0.05];
const FOOT_RADIUS_M: f32 = 0.035;

const GROUND: [&str; 2] = ["#dfe3dc", "#c3c9bf"];
const GROUND_LINE: [&str; 2] = ["#b5bcb1", "#7d867a"];
const LEG: [&str; 2] = ["#aab4c2", "#3d4b5f"];
const BODY: &str = "#0072b2";

/// The strip: `frames` pictures from the first tick to the last, with their times and a scale.
pub(crate) fn strip(robot: &RobotModel, watched: &Watched, title: &str, frames: usize) -> String {
    let rows = frames.div_ceil(COLUMNS);
    let [frame_w, frame_h] = FRAME_M.map(|metres| metres * SCALE);
    let width = COLUMNS.min(frames) as f32 * (frame_w + GAP_PX) + GAP_PX;
    let height = TITLE_PX + rows as f32 * (frame_h + GAP_PX);
    let mut svg = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{width}\" height=\"{height}\" \
         viewBox=\"0 0 {width} {height}\" font-family=\"system-ui, sans-serif\" font-size=\"14\">\n\
         <rect width=\"100%\" height=\"100%\" fill=\"#ffffff\"/>\n\
         <text x=\"{GAP_PX}\" y=\"22\" fill=\"#17191c\">{}</text>\n\
         <clipPath id=\"frame\"><rect width=\"{frame_w}\" height=\"{frame_h}\"/></clipPath>\n",
        escaped(title)
    );
    let last = watched.ticks.len().saturating_sub(1);
    for frame in 0..frames {
        let tick = frame * last / (frames - 1).max(1);
        let Some(measured) = watched.ticks.get(tick) else { break };
        let x = GAP_PX + (frame % COLUMNS) as f32 * (frame_w + GAP_PX);
        let y = TITLE_PX + (frame / COLUMNS) as f32 * (frame_h + GAP_PX);
        let _ = writeln!(svg, "<g transform=\"translate({x} {y})\" clip-path=\"url(#frame)\">");
        let _ = writeln!(svg, "<rect width=\"{frame_w}\" height=\"{frame_h}\" fill=\"#f4f6f8\"/>");
        let camera = Camera::at(measured);
        camera.draw(&mut svg, robot, watched, measured);
        let time_s = tick as f64 * TICK_S;
        let _ = writeln!(svg, "<text x=\"8\" y=\"20\" fill=\"#17191c\">{time_s:.2} s</text>");
        if frame == 0 {
            camera.scale_bar(&mut svg);
        }
        svg.push_str("</g>\n");
    }
    svg.push_str("</svg>\n");
    svg
}

fn escaped(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;")
}

/// Looks at the base from the right, straight across the path.
struct Camera {
    left_m: f32,
    top_m: f32,
}

impl Camera {
    fn at(measured: &Measurement) -> Self {
        let [x_m, _, z_m] = measured.base.position_m;
        Self { left_m: x_m - 0.5 * FRAME_M[0], top_m: z_m - BELOW_BASE_M + FRAME_M[1] }
    }

    fn pixel(&self, point_m: [f32; 3]) -> [f32; 2] {
        [(point_m[0] - self.left_m) * SCALE, (self.top_m - point_m[2]) * SCALE]
    }

    fn points(&self, points_m: &[[f32; 3]]) -> String {
        let mut text = String::new();
        for point_m in points_m {
            let [x, y] = self.pixel(*point_m);
            let _ = write!(text, "{x:.1},{y:.1} ");
        }
        text
    }

    fn draw(&self, svg: &mut String, robot: &RobotModel, watched: &Watched, measured: &Measurement) {
        let links = forward_kinematics(&robot.description, &measured.base, &measured.joint_position_rad);
        let legs = legs(&robot.description, &links);
        let is_near = |leg: &[[f32; 3]]| measured.base.vector_in_body(across(leg, measured))[1] < 0.0;
        self.ground(svg, watched, 0);
        for (near, colour) in [(false, LEG[0]), (true, LEG[1])] {
            if near {
                self.body(svg, robot, measured);
                self.ground(svg, watched, 1);
            }
            for (leg, touches) in legs.iter().zip(&measured.foot_contact) {
                if is_near(leg) == near {
                    self.leg(svg, leg, colour, *touches);
                }
            }
        }
    }

    /// The ground under one side's feet.
    fn ground(&self, svg: &mut String, watched: &Watched, lane: usize) {
        let bottom_m = self.top_m - FRAME_M[1] - 0.1;
        let mut outline = vec![[self.left_m, 0.0, bottom_m]];
        for n in 0..=(FRAME_M[0] / PROFILE_EVERY_M) as usize {
            let x_m = self.left_m + n as f32 * PROFILE_EVERY_M;
            let z_m = watched.ground_m(x_m, LANES_M[lane]);
            outline.push([x_m, 0.0, if z_m.is_finite() { z_m.max(bottom_m) } else { bottom_m }]);
        }
        outline.push([self.left_m + FRAME_M[0], 0.0, bottom_m]);
        let (points, fill, line) = (self.points(&outline), GROUND[lane], GROUND_LINE[lane]);
        let _ = writeln!(svg, "<polygon points=\"{points}\" fill=\"{fill}\" stroke=\"{line}\"/>");
    }

    fn body(&self, svg: &mut String, robot: &RobotModel, measured: &Measurement) {
        for [centre, half] in base_boxes(robot) {
            let corner = |x: f64, z: f64| {
                let in_base = [centre[0] + x * half[0], centre[1], centre[2] + z * half[2]];
                let along = measured.base.vector_in_world(in_base.map(|part| part as f32));
                [0, 1, 2].map(|axis| measured.base.position_m[axis] + along[axis])
            };
            let sides = [corner(-1.0, -1.0), corner(1.0, -1.0), corner(1.0, 1.0), corner(-1.0, 1.0)];
            let points = self.points(&sides);
            let _ = writeln!(
                svg,
                "<polygon points=\"{points}\" fill=\"{BODY}\" stroke=\"{BODY}\" stroke-width=\"8\" \
                 stroke-linejoin=\"round\"/>"
            );
        }
    }

    fn leg(&self, svg: &mut String, leg: &[[f32; 3]], colour: &str, touches: bool) {
        for (pair, thick_m) in leg.windows(2).zip(LIMB_M) {
            let ([x1, y1], [x2, y2]) = (self.pixel(pair[0]), self.pixel(pair[1]));
            let _ = writeln!(
                svg,
                "<line x1=\"{x1:.1}\" y1=\"{y1:.1}\" x2=\"{x2:.1}\" y2=\"{y2:.1}\" stroke=\"{colour}\" \
                 stroke-width=\"{:.1}\" stroke-linecap=\"round\"/>",
                thick_m * SCALE
            );
        }
        if let Some(foot) = leg.last() {
            let ([x, y], radius) = (self.pixel(*foot), FOOT_RADIUS_M * SCALE);
            let fill = if touches { "#17191c" } else { "#ffffff" };
            let _ = writeln!(
                svg,
                "<circle cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"{radius}\" fill=\"{fill}\" stroke=\"#17191c\"/>"
            );
        }
    }

    #[expect(clippy::unused_self, reason = "a scale belongs to a camera; all cameras have the same")]
    fn scale_bar(&self, svg: &mut String) {
        let ([width, height], bar) = (FRAME_M.map(|metres| metres * SCALE), 0.5 * SCALE);
        let (x, y) = (width - bar - 10.0, height - 12.0);
        let _ = writeln!(
            svg,
            "<path d=\"M{x} {y}h{bar}m0 -4v8m-{bar} -8v8\" stroke=\"#17191c\" fill=\"none\"/>\
             <text x=\"{x}\" y=\"{}\" fill=\"#17191c\">0.5 m</text>",
            y - 7.0
        );
    }
}

/// From the base's origin to where a leg begins, in the path's frame.
fn across(leg: &[[f32; 3]], measured: &Measurement) -> [f32; 3] {
    [0, 1, 2].map(|axis| leg[0][axis] - measured.base.position_m[axis])
}
