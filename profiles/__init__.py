"""Who the patient is: schema, anthropometry, calibration, store."""
