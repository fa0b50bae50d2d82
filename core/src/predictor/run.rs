//! One model run by the process's ONNX runtime, and nothing kept of it.
#![allow(unsafe_code, reason = "calls the model runtime by its C interface")]

use std::ffi::CString;
use std::ptr::{self, NonNull};

use ort::session::Session;
use ort::sys::{ONNXTensorElementDataType, OrtValue};
use ort::value::Tensor;
use ort::{AsPointer, Error};

/// Runs a model of one input; what `read` makes of the shape and the values of `output`, or nothing where the model
/// has no such output.
///
/// `Session::run` of ort 2.0.0-rc.14 asks the runtime for a description of every output and never releases it: some
/// 40 bytes a run, hundreds of megabytes a day at 50 Hz.
///
/// # Errors
/// The runtime fails, or the output is no tensor of f32.
pub(crate) fn run<T>(
    session: &mut Session,
    (input_name, input): (&str, &Tensor<f32>),
    output: &str,
    read: impl FnOnce(&[i64], &[f32]) -> T,
) -> Result<Option<T>, Error> {
    let named = |name: &str| CString::new(name).map_err(|error| Error::new(error.to_string()));
    let (input_name, output) = (named(input_name)?, named(output)?);
    let (input_names, inputs, output_names) = ([input_name.as_ptr()], [input.ptr()], [output.as_ptr()]);
    let api = ort::api();
    let mut value = ptr::null_mut();
    // SAFETY: one name and one value in, one name and one place out, all of which live through the call.
    unsafe {
        Error::result_from_status((api.Run)(
            session.ptr_mut(),
            ptr::null(),
            input_names.as_ptr(),
            inputs.as_ptr(),
            1,
            output_names.as_ptr(),
            1,
            &raw mut value,
        ))?;
    }
    let Some(value) = NonNull::new(value).map(Output) else { return Ok(None) };
    let (mut kind, mut shape, mut rank, mut data) =
        (ONNXTensorElementDataType::ONNX_TENSOR_ELEMENT_DATA_TYPE_UNDEFINED, ptr::null(), 0, ptr::null_mut());
    let pointer = value.0.as_ptr();
    // SAFETY: the value is the runtime's own, and alive; each place is written once.
    unsafe {
        Error::result_from_status((api.GetTensorElementTypeAndShapeDataReference)(
            pointer,
            &raw mut kind,
            &raw mut shape,
            &raw mut rank,
        ))?;
        Error::result_from_status((api.GetTensorMutableData)(pointer, &raw mut data))?;
    }
    if kind != ONNXTensorElementDataType::ONNX_TENSOR_ELEMENT_DATA_TYPE_FLOAT {
        return Err(Error::new(format!("an output of {kind:?}, wanted f32")));
    }
    // SAFETY: `rank` sizes, and of their product as many numbers of that type, for as long as the value lives.
    let shape = unsafe { slice(shape, rank) };
    let count = shape.iter().map(|&size| usize::try_from(size).unwrap_or(0)).product();
    // SAFETY: as above.
    let values = unsafe { slice(data.cast_const().cast::<f32>(), count) };
    Ok(Some(read(shape, values)))
}

/// A slice of what the runtime points to, which may be nowhere when there is nothing.
///
/// # Safety
/// `count` values are there, for as long as the slice is used.
unsafe fn slice<'a, T>(values: *const T, count: usize) -> &'a [T] {
    if count == 0 || values.is_null() {
        return &[];
    }
    // SAFETY: as asked of the caller.
    unsafe { std::slice::from_raw_parts(values, count) }
}

/// A value that the runtime has made for its caller, who releases it.
struct Output(NonNull<OrtValue>);

impl Drop for Output {
    fn drop(&mut self) {
        // SAFETY: made by the runtime, and released once.
        unsafe { (ort::api().ReleaseValue)(self.0.as_ptr()) };
    }
}
