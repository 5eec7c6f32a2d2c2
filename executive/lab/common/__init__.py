"""What experiments share: progress bars, folder locks, figures and HTML pages."""
