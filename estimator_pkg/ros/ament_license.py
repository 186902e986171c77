# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The licence header of our files, which ament_copyright finds through its entry point.

Its own header for Apache-2.0 has 13 lines; this one has two. Only ament_copyright imports this
module.
"""

from ament_copyright.licenses import LicenseEntryPoint

APACHE_2_SPDX = LicenseEntryPoint(
    name='Apache License, Version 2.0 (SPDX identifier)',
    spdx='Apache-2.0',
    file_headers=['{copyright}\nSPDX-License-Identifier: Apache-2.0'],
    license_files=[],
    contributing_files=[],
)
