"""The series of a large scene part by part: every body and row has its own, an event changes only what it reaches."""
