"""The paper's tables made again: what each trains and scores, beside the paper's figures."""
