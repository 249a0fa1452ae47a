"""Pictures of the stability laws."""
