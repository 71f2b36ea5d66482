"""The journal: writer, reader, segments, snapshots and recovery after a crash."""
