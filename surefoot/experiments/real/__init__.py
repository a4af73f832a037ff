"""Studies on real recordings; `support/real_data.py` says where they are expected."""
