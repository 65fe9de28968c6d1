"""The application: scenario, flight, benchmark, report and command line."""
