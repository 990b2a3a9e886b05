//! Simulated worlds and sensors with exact truth.
