"""A lab's own files become a recording: a spreadsheet, or a bag with several clocks."""
