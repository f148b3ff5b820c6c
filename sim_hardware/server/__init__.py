"""What the bench offers to other processes: NI's gRPC device server and its own control service."""
