"""Reading what others wrote: bounded in size, from plain files, and fit to be shown."""
