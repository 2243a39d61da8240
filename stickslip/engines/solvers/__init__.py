"""What CVODE and IDA share: SUNDIALS, the points that it computes, and the events on and between them."""
