//! A line in: JSON with names at the border, an [`Observation`] in the robot's order inside.

use serde_json::{Map, Value};
use vocaloco_plugin_api::{Command, RobotDescription};

use crate::elevation::Elevation;
use crate::observation::{BaseInOdom, Observation, ObservationFault};

type Parsed<T> = Result<T, ObservationFault>;

/// The observation that a line holds.
///
/// # Errors
/// The first field that is missing, unknown, of the wrong kind, or not a finite number. Terrain of
/// the wrong size is no error: the robot stops for it.
pub fn parse(line: &[u8], robot: &RobotDescription) -> Parsed<Observation> {
    let value: Value = serde_json::from_slice(line).map_err(|error| not_json(line, &error))?;
    let mut object = Object::of(&value, "")?;
    let joints: Vec<&str> = robot.joints.iter().map(|joint| joint.name.as_str()).collect();
    let feet: Vec<&str> = robot.feet.iter().map(|foot| foot.name.as_str()).collect();
    let observation = Observation {
        t_s: double(object.need("t_s")?, "t_s")?,
        joint_position_rad: by_name(&mut object, "joint_position_rad", &joints, number)?,
        joint_velocity_rad_per_s: by_name(&mut object, "joint_velocity_rad_per_s", &joints, number)?,
        joint_torque_nm: if object.has("joint_torque_nm") {
            Some(by_name(&mut object, "joint_torque_nm", &joints, number)?)
        } else {
            None
        },
        foot_contact: if object.has("foot_contact") {
            Some(by_name(&mut object, "foot_contact", &feet, flag)?)
        } else {
            None
        },
        base_linear_velocity: numbers(&mut object, "base_linear_velocity_m_per_s")?,
        base_angular_velocity: numbers(&mut object, "base_angular_velocity_rad_per_s")?,
        projected_gravity: numbers(&mut object, "projected_gravity")?,
        base_in_odom: object.take("base_in_odom").map(base_in_odom).transpose()?,
        elevation: object.take("elevation").map(elevation).transpose()?,
        command: command(object.need("command")?)?,
        field_noise: None,
        heightfield: None,
    };
    object.finish()?;
    Ok(observation)
}

/// Why a line is no JSON; Python and many maps write what JSON has no number for.
fn not_json(line: &[u8], error: &serde_json::Error) -> ObservationFault {
    let at = error.column().saturating_sub(2);
    let rest = line.get(at..).unwrap_or_default();
    let wanted = "one JSON object; an unknown height is null";
    match [&b"NaN"[..], b"Infinity", b"-Infinity"]
        .into_iter()
        .find(|word| rest.starts_with(word) || rest.get(1..).is_some_and(|rest| rest.starts_with(word)))
    {
        Some(word) => {
            let found = format!("{} at column {}", String::from_utf8_lossy(word), error.column());
            ObservationFault::new("line", found, wanted)
        }
        None => ObservationFault::new("line", error, "one JSON object"),
    }
}

/// An object whose fields are taken one by one; what is left at the end is unknown.
struct Object<'a> {
    fields: &'a Map<String, Value>,
    path: String,
    taken: Vec<&'static str>,
}

impl<'a> Object<'a> {
    fn of(value: &'a Value, path: &str) -> Parsed<Self> {
        match value {
            Value::Object(fields) => Ok(Self { fields, path: path.to_owned(), taken: Vec::new() }),
            other => {
                let field = if path.is_empty() { "line" } else { path };
                Err(ObservationFault::new(field, shown(other), "an object"))
            }
        }
    }

    fn name(&self, field: &str) -> String {
        if self.path.is_empty() { field.to_owned() } else { format!("{}.{field}", self.path) }
    }

    fn has(&mut self, field: &'static str) -> bool {
        self.fields.get(field).is_some_and(|value| !value.is_null()) || {
            self.taken.push(field);
            false
        }
    }

    /// The field's value; `null` counts as left out.
    fn take(&mut self, field: &'static str) -> Option<&'a Value> {
        self.taken.push(field);
        self.fields.get(field).filter(|value| !value.is_null())
    }

    fn need(&mut self, field: &'static str) -> Parsed<&'a Value> {
        self.take(field).ok_or_else(|| ObservationFault::new(self.name(field), "nothing", "a value"))
    }

    fn finish(self) -> Parsed<()> {
        match self.fields.keys().find(|key| !self.taken.contains(&key.as_str())) {
            Some(unknown) => {
                let wanted = format!("one of {}", self.taken.join(", "));
                Err(ObservationFault::new(self.name(unknown), "an unknown field", wanted))
            }
            None => Ok(()),
        }
    }
}

fn by_name<T>(
    object: &mut Object<'_>,
    field: &'static str,
    names: &[&str],
    read: impl Fn(&Value, &str) -> Parsed<T>,
) -> Parsed<Vec<T>> {
    let inner = Object::of(object.need(field)?, field)?;
    let mut values = Vec::with_capacity(names.len());
    for &name in names {
        let path = inner.name(name);
        let value = inner.fields.get(name);
        let value = value.ok_or_else(|| ObservationFault::new(path.clone(), "nothing", "a value"))?;
        values.push(read(value, &path)?);
    }
    match inner.fields.keys().find(|key| !names.contains(&key.as_str())) {
        Some(unknown) => {
            let wanted = format!("one of {}", names.join(", "));
            Err(ObservationFault::new(inner.name(unknown), "an unknown name", wanted))
        }
        None => Ok(values),
    }
}

fn double(value: &Value, field: &str) -> Parsed<f64> {
    let number = value.as_f64().filter(|number| number.is_finite());
    number.ok_or_else(|| ObservationFault::new(field, shown(value), "a finite number"))
}

fn number(value: &Value, field: &str) -> Parsed<f32> {
    let number = double(value, field)? as f32;
    // 1e300 is a finite double and an infinite single.
    if number.is_finite() {
        return Ok(number);
    }
    Err(ObservationFault::new(field, shown(value), "a finite number"))
}

fn flag(value: &Value, field: &str) -> Parsed<bool> {
    value.as_bool().ok_or_else(|| ObservationFault::new(field, shown(value), "true or false"))
}

fn array<const N: usize>(value: &Value, field: &str) -> Parsed<[f64; N]> {
    let wanted = || ObservationFault::new(field, shown(value), format!("an array of {N} numbers"));
    let items = value.as_array().filter(|items| items.len() == N).ok_or_else(wanted)?;
    let mut out = [0.0; N];
    for (index, (out, item)) in out.iter_mut().zip(items).enumerate() {
        *out = f64::from(number(item, &format!("{field}[{index}]"))?);
    }
    Ok(out)
}

fn numbers(object: &mut Object<'_>, field: &'static str) -> Parsed<[f32; 3]> {
    Ok(array::<3>(object.need(field)?, field)?.map(|value| value as f32))
}

fn command(value: &Value) -> Parsed<Command> {
    let mut object = Object::of(value, "command")?;
    let velocity: [f64; 3] = array(object.need("velocity")?, "command.velocity")?;
    object.finish()?;
    let [forward, left, yaw_rate] = velocity.map(|value| value as f32);
    Ok(Command::velocity(forward, left, yaw_rate))
}

fn base_in_odom(value: &Value) -> Parsed<BaseInOdom> {
    let mut object = Object::of(value, "base_in_odom")?;
    let base = BaseInOdom {
        position_m: array(object.need("position_m")?, "base_in_odom.position_m")?,
        orientation_xyzw: array(object.need("orientation_xyzw")?, "base_in_odom.orientation_xyzw")?,
    };
    object.finish()?;
    Ok(base)
}

fn elevation(value: &Value) -> Parsed<Elevation> {
    let mut object = Object::of(value, "elevation")?;
    let mut extent = |field: &'static str| {
        let path = object.name(field);
        double(object.need(field)?, &path)
    };
    let (t_s, resolution_m) = (extent("t_s")?, extent("resolution_m")?);
    let (back_m, front_m, half_width_m) = (extent("back_m")?, extent("front_m")?, extent("half_width_m")?);
    let rows = object.need("height_m")?;
    let (height_m, columns) = heights(rows)?;
    object.finish()?;
    let mut elevation = Elevation { t_s, resolution_m, back_m, front_m, half_width_m, height_m };
    if columns != Some(elevation.columns()) {
        // As many heights in rows of another length are another map: transposed, for one.
        elevation.height_m.clear();
    }
    Ok(elevation)
}

/// Rows of heights, and their length; `null` is unknown. Rows of unequal length have none.
fn heights(value: &Value) -> Parsed<(Vec<f32>, Option<usize>)> {
    let field = "elevation.height_m";
    let wanted = |path: &str, found: &Value| {
        Err(ObservationFault::new(path, shown(found), "rows of numbers, null where unknown"))
    };
    let Some(rows) = value.as_array() else { return wanted(field, value) };
    let mut heights = Vec::new();
    let mut columns = None;
    let mut ragged = false;
    for (i, row) in rows.iter().enumerate() {
        let Some(cells) = row.as_array() else { return wanted(&format!("{field}[{i}]"), row) };
        ragged |= *columns.get_or_insert(cells.len()) != cells.len();
        for (j, cell) in cells.iter().enumerate() {
            heights.push(match cell {
                Value::Null => f32::NAN,
                Value::Number(_) => number(cell, &format!("{field}[{i}][{j}]"))?,
                other => return wanted(&format!("{field}[{i}][{j}]"), other),
            });
        }
    }
    Ok((heights, columns.filter(|_| !ragged)))
}

/// A value as an error shows it: kind, and the text when it is short.
fn shown(value: &Value) -> String {
    match value {
        Value::Object(_) => "an object".to_owned(),
        Value::Array(items) => format!("an array of {}", items.len()),
        Value::String(text) if text.chars().count() > 40 => "a long text".to_owned(),
        other => other.to_string(),
    }
}
