//! Numbers on the command line.

/// Parses a number from `least` to `most`, both included.
pub(crate) fn number(least: f64, most: f64) -> impl Fn(&str) -> Result<f64, String> + Clone + Send + Sync {
    move |text| match text.trim().parse::<f64>() {
        Ok(number) if (least..=most).contains(&number) => Ok(number),
        _ => Err(format!("expected a number from {least} to {most}")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_read_and_what_is_out_of_bounds_is_not() {
        let share = number(0.0, 1.0);
        assert_eq!([share("0"), share(" 0.25"), share("1")], [Ok(0.0), Ok(0.25), Ok(1.0)]);
        for text in ["nan", "-1", "7", "inf", "", "x"] {
            assert_eq!(share(text), Err("expected a number from 0 to 1".to_owned()), "{text}");
        }
    }
}
