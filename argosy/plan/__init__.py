"""Plan files of ground stations, and the missions that vehicles store."""
