"""Exchange: what others can check and use, a run in one file, a run counted again, a reference as images or JSON."""
